#pragma once

#include <sensor_msgs/PointCloud2.h>
#include <visualization_msgs/MarkerArray.h>

#include <string>
#include <vector>

#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam {

/// rviz draws no more points than this from one marker.
constexpr std::size_t kMaxPointsPerMarker = 16384;

/// Landmarks whose positions are in `frame`: POINTS markers with ids 0, 1, ... of at most kMaxPointsPerMarker
/// points each, coloured by uncertainty; those of the `previous_markers` that are no longer needed are
/// deleted.
visualization_msgs::MarkerArray toMarkers(const std::vector<LandmarkEstimate>& landmarks, Stamp stamp,
                                          const std::string& frame, std::size_t previous_markers);

/// A LINE_LIST of its own namespace, `loop_closures`: a line between the two ends of each loop that was
/// closed, as they are known now.
visualization_msgs::Marker loopMarker(const PathEstimate& path, Stamp stamp, const std::string& frame);

/// One DELETEALL.
visualization_msgs::MarkerArray deleteAllMarkers(const std::string& frame);

/// Fields x, y, z, sigma (FLOAT32, m), id, id_high (UINT32, low and high half of the landmark's id) and
/// log10_sigma (FLOAT32, of sigma in m, for a colour scale; that of 1 mm where sigma is less).
sensor_msgs::PointCloud2 toCloud(const std::vector<LandmarkEstimate>& landmarks, Stamp stamp,
                                 const std::string& frame);

} // namespace vi_ekf_slam

#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// 256-bit ORB descriptors (Rublee et al. 2011) of the points, px, each along the direction of its
/// surroundings' intensity centroid.
std::vector<Descriptor> describePoints(const cv::Mat& image, const std::vector<cv::Point2f>& points);

} // namespace vi_ekf_slam

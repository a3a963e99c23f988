#pragma once

#include <Eigen/Core>
#include <vector>

#include "vi_ekf_slam/core/map/path_estimate.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

struct LandmarkEstimate {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();   ///< world frame, m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(); ///< m^2, world axes, marginal
};

/// Landmarks by id, and the path so far, all as known now.
struct MapEstimate {
  std::vector<LandmarkEstimate> landmarks;
  PathEstimate path;
};

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "vi_ekf_slam/core/measurement.hpp"

namespace vi_ekf_slam::invariant {

struct Landmark {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero(); ///< world, m
  std::size_t observations = 1;                       ///< that corrected the state, the first one included
  bool anchored = false; ///< known from an earlier time, not in view yet: tracks that slide do not move it
};

} // namespace vi_ekf_slam::invariant

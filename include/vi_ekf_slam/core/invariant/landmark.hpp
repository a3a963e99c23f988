#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam::invariant {

struct Landmark {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero(); ///< world, m
  std::size_t observations = 1;                       ///< that corrected the state, the first one included
  bool anchored = false; ///< known from an earlier time, not in view yet: tracks that slide do not move it
  double tracked_since = 0.0; ///< m that the vehicle had driven when its track began
};

/// A landmark out of view and the covariance (3x3, m^2, world axes) of its error d = m - m^.
struct InactiveLandmark {
  Landmark landmark;
  Eigen::Matrix3d covariance;
};

/// Of so many landmarks' errors, or of so many points' measurements.
inline Eigen::Index rowsOf(std::size_t landmarks) { return 3 * static_cast<Eigen::Index>(landmarks); }

} // namespace vi_ekf_slam::invariant

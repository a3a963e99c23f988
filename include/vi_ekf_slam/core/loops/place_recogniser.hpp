#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// A landmark as the recogniser sees it: a point (world, m) with a name.
struct PlacePoint {
  FeatureId id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
};

/// A place found again.
struct Recognition {
  SE3 before_T_now; ///< moves what is seen now onto what was seen before, world axes
  std::vector<std::pair<FeatureId, FeatureId>> matches; ///< (now, before)
};

/// Finds points seen now among points seen before by their constellation alone: no appearance, no ids.
/// Matches are proposed where they are possible under the uncertainty of the present pose and agree with each
/// other in pairs (the distance of two points does not depend on where one is); rigid transforms through
/// three of them are verified on all points. What is found must be far beyond what chance gives, must not
/// have a rival, and must be spread out: a false loop is worse than none.
///
/// `about` is the vehicle's position (world, m), `covariance` the 6x6 of (position, rotation) along the world
/// axes of its error against the points seen before. Deterministic. Nothing where nothing is recognised.
std::optional<Recognition> recognisePlace(const std::vector<PlacePoint>& now,
                                          const std::vector<PlacePoint>& before, const Eigen::Vector3d& about,
                                          const Matrix6d& covariance);

} // namespace vi_ekf_slam

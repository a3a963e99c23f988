#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"

namespace vi_ekf_slam {

/// A landmark, and where it is seen if the pose is right (both world, m).
struct Displaced {
  Eigen::Vector3d expected;
  Eigen::Vector3d seen;
  Eigen::Matrix3d covariance; ///< of the noise between the two, m^2, world axes
};

/// The rigid motion T with expected = T seen on which most of the points agree: the vehicle is at T T^ where
/// the estimate says T^. RANSAC over three points, the same ones each time, then least squares. Nothing when
/// less than `share` of them (above 0), or less than five, agree within the 99.7 % bound of their covariance.
std::optional<SE3> commonMotion(const std::vector<Displaced>& points, double share = 0.6);

/// Which of the points agree with the motion within that bound.
std::vector<std::size_t> agreeing(const std::vector<Displaced>& points, const SE3& motion);

} // namespace vi_ekf_slam

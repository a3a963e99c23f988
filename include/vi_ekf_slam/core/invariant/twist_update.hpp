#pragma once

#include "vi_ekf_slam/core/invariant/state.hpp"

namespace vi_ekf_slam::invariant {

/// z = nu + b + noise for three components of the twist: `axis` 0 (linear, m/s) or 3 (angular, rad/s).
/// `noise` is the 3x3 covariance of `measured`.
void measureTwist(State& state, Eigen::Index axis, const Eigen::Vector3d& measured,
                  const Eigen::Matrix3d& noise);

/// The body stands still: nu = 0 with the standard deviations `sigma` (m/s and rad/s).
void measureStandstill(State& state, const Vector6d& sigma);

} // namespace vi_ekf_slam::invariant

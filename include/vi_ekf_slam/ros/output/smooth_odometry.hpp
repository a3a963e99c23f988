#pragma once

#include <optional>

#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam {

/// Dead reckoning that never jumps: over a new start of the estimator it goes on from where it was.
class SmoothOdometry {
 public:
  /// `start_T_base`: dead reckoning since the last start; `state` of the same stamp. Pose and covariance are
  /// in odom, where the pose is of the base from its first one on; the twist stays.
  ///
  /// The covariance grows by what the twist's covariance makes of the way: the twist's errors are taken to
  /// last for 1 s, and then to be others.
  StateEstimate update(const SE3& start_T_base, const StateEstimate& state);
  /// odom_T_base of the last update.
  const SE3& pose() const { return pose_; }
  /// The dead reckoning begins anew.
  void restart();

 private:
  SE3 odom_T_start_;
  SE3 pose_;
  Matrix6d covariance_ = Matrix6d::Zero();
  std::optional<Stamp> stamp_;
};

} // namespace vi_ekf_slam

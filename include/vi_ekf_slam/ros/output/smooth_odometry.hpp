#pragma once

#include <map>
#include <optional>

#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam {

/// Dead reckoning that never jumps: over a new start of the estimator it goes on from where it was.
class SmoothOdometry {
 public:
  /// `start_T_base`: dead reckoning since the last start, wherever that began; `state` of the same stamp.
  /// Pose and covariance are in odom, where the pose is of the base from its first one on; the twist stays.
  ///
  /// The covariance grows by what the twist's covariance makes of the way: the twist's errors are taken to
  /// last for 1 s, and then to be others.
  StateEstimate update(const SE3& start_T_base, const StateEstimate& state);
  /// then_T_now, by which the base has moved since a stamp of the last 10 s; of any other stamp nothing is
  /// known, and the identity is returned.
  SE3 motionSince(Stamp then) const;
  /// The dead reckoning begins anew.
  void restart();

 private:
  static constexpr double kMemory = 10.0;               // s
  static constexpr std::size_t kMostRemembered = 10000; // poses

  SE3 odom_T_start_;
  std::map<Stamp, SE3> poses_; ///< of the last while
  SE3 pose_;
  Matrix6d covariance_ = Matrix6d::Zero();
  std::optional<Stamp> stamp_;
  bool is_restarted_ = false;
};

} // namespace vi_ekf_slam

#pragma once

#include <optional>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Integrates the measured twist: T <- T Exp(dt u), each sample held until the next (paper eq. 9 without
/// noise, for the pose instead of its inverse). Starts at the identity, unless told where,
/// with the first measurement, at rest until told otherwise.
class DeadReckoning {
 public:
  void process(const ImuSample& sample);
  void process(const VelocitySample& sample);
  void process(const StereoFrame& frame) { advanceTo(frame.stamp); }
  /// From now on the body moves like this, (m/s, rad/s) in its axes: an estimate's twist, where samples of
  /// the velocity are not what there is to integrate.
  void setTwist(Stamp stamp, const Vector6d& twist);
  void begin(const SE3& pose) { pose_ = pose; }
  /// Moves on to `stamp`, which must not be older than the last one.
  void advanceTo(Stamp stamp);

  const SE3& pose() const { return pose_; }
  const Vector6d& twist() const { return twist_; }
  std::optional<Stamp> stamp() const { return stamp_; }

 private:
  SE3 pose_;
  Vector6d twist_ = Vector6d::Zero();
  std::optional<Stamp> stamp_;
};

} // namespace vi_ekf_slam

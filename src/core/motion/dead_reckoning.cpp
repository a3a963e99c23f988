#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"

namespace vi_ekf_slam {

void DeadReckoning::process(const ImuSample& sample) {
  advanceTo(sample.stamp);
  twist_.tail<3>() = sample.angular_velocity;
}

void DeadReckoning::process(const VelocitySample& sample) {
  advanceTo(sample.stamp);
  twist_.head<3>() = sample.linear_velocity;
}

void DeadReckoning::setTwist(Stamp stamp, const Vector6d& twist) {
  advanceTo(stamp);
  twist_ = twist;
}

void DeadReckoning::advanceTo(Stamp stamp) {
  if (stamp_ && stamp > *stamp_) {
    pose_ = (pose_ * SE3::Exp(secondsBetween(*stamp_, stamp) * twist_)).normalized();
  }
  stamp_ = stamp;
}

} // namespace vi_ekf_slam

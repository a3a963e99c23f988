#include "vi_ekf_slam/ros/output/smooth_odometry.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kCorrelationTime = 1.0; // s that an error of the twist lasts

} // namespace

StateEstimate SmoothOdometry::update(const SE3& start_T_base, const StateEstimate& state) {
  if (std::exchange(is_restarted_, false)) odom_T_start_ = pose_ * start_T_base.inverse();
  const SE3 before = pose_;
  pose_ = (odom_T_start_ * start_T_base).normalized();
  if (stamp_ && state.stamp > *stamp_) {
    const double dt = secondsBetween(*stamp_, state.stamp);
    Matrix6d F = Matrix6d::Identity(); // dp' = dp - [p' - p]x dtheta
    F.topRightCorner<3, 3>() = -so3::hat(pose_.translation() - before.translation());
    Matrix6d turn = Matrix6d::Zero();
    turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = pose_.rotation();
    const Matrix6d Q = dt * std::max(dt, kCorrelationTime) * turn * state.twist_covariance * turn.transpose();
    const Matrix6d next = F * covariance_ * F.transpose() + Q;
    covariance_ = 0.5 * (next + next.transpose());
  }
  stamp_ = state.stamp;
  poses_[state.stamp] = pose_;
  while (secondsBetween(poses_.begin()->first, state.stamp) > kMemory || poses_.size() > kMostRemembered)
    poses_.erase(poses_.begin());
  StateEstimate odometry = state;
  odometry.world_T_imu = pose_;
  odometry.pose_covariance = covariance_;
  return odometry;
}

SE3 SmoothOdometry::motionSince(Stamp then) const {
  const auto after = poses_.lower_bound(then);
  if (after == poses_.end() || (after == poses_.begin() && after->first != then)) return SE3();
  return after->second.inverse() * pose_;
}

void SmoothOdometry::restart() {
  poses_.clear();
  is_restarted_ = true;
  stamp_.reset();
}

} // namespace vi_ekf_slam

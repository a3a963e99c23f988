#include "vi_ekf_slam/front_end/motion_predictor.hpp"

namespace vi_ekf_slam {

MotionPredictor::Prediction MotionPredictor::predict(Stamp before, Stamp now) const {
  const SE3 motion = SE3::Exp(secondsBetween(before, now) * velocity_);
  const auto before_R_now = cam_R_imu_ ? gyro_.between(before, now) : std::nullopt;
  if (!before_R_now) return {motion, false};
  return {{*cam_R_imu_ * before_R_now->transpose() * cam_R_imu_->transpose(), motion.translation()}, true};
}

void MotionPredictor::learn(const std::optional<SE3>& now_T_before, double seconds) {
  velocity_ = now_T_before ? (now_T_before->Log() / seconds).eval() : Vector6d::Zero().eval();
}

} // namespace vi_ekf_slam

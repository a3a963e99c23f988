#include "vi_ekf_slam/front_end/motion_predictor.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kBiasPairs = 20; // a bias drifts within minutes, and that of one pair has its noise

} // namespace

MotionPredictor::Prediction MotionPredictor::predict(Stamp before, Stamp now) const {
  const SE3 motion = SE3::Exp(secondsBetween(before, now) * velocity_);
  const auto before_R_now = cam_R_imu_ ? gyro_.between(before, now) : std::nullopt;
  if (!before_R_now) return {motion, false};
  return {{*cam_R_imu_ * before_R_now->transpose() * cam_R_imu_->transpose(), motion.translation()}, true};
}

SE3 MotionPredictor::withoutBias(const SE3& now_T_before, double seconds) const {
  return {so3::Exp(seconds * bias_) * now_T_before.rotation(), now_T_before.translation()};
}

void MotionPredictor::learn(const std::optional<SE3>& now_T_before, const Prediction& prediction,
                            double seconds) {
  velocity_ = now_T_before ? (now_T_before->Log() / seconds).eval() : Vector6d::Zero().eval();
  if (!now_T_before || !prediction.rotation_known) return;
  const Eigen::Vector3d beyond =
      so3::Log(now_T_before->rotation() * prediction.now_T_before.rotation().transpose()) / seconds;
  bias_pairs_ = std::min(bias_pairs_ + 1, kBiasPairs);
  bias_ += (beyond - bias_) / bias_pairs_;
}

} // namespace vi_ekf_slam

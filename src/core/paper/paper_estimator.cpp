#include "vi_ekf_slam/core/paper/paper_estimator.hpp"

namespace vi_ekf_slam::paper {

PaperEstimator::PaperEstimator(const PaperConfig& config)
    : config_(config), mapper_(config), joint_(config) {}

void PaperEstimator::process(const ImuSample& sample) {
  predictTo(sample.stamp);
  held_.process(sample);
}

void PaperEstimator::process(const VelocitySample& sample) {
  predictTo(sample.stamp);
  held_.process(sample);
}

FrameReport PaperEstimator::process(const StereoFrame& frame) {
  predictTo(frame.stamp);
  held_.process(frame);
  if (rig_ && config_.mode == PaperMode::kMapping) return mapper_.update(*rig_, joint_.imuTWorld(), frame);
  if (rig_ && config_.mode == PaperMode::kSlam) return joint_.update(*rig_, frame);
  FrameReport report(frame);
  report.invalid = config_.mode == PaperMode::kDeadReckoning ? 0 : report.features;
  return report;
}

void PaperEstimator::predictTo(Stamp stamp) {
  const double tau = held_.stamp() ? secondsBetween(*held_.stamp(), stamp) : 0.0;
  if (!(tau > 0.0)) return;
  const Matrix6d W = (tau / config_.step_s * config_.motion_noise).asDiagonal();
  joint_.predict(held_.twist(), tau, W);
}

StateEstimate PaperEstimator::state() const {
  StateEstimate state;
  state.stamp = held_.stamp().value_or(0);
  state.world_T_imu = joint_.imuTWorld().inverse();
  // U = Exp(delta) U^ means T = T^ Exp(-delta): the error along the world axes is -R delta, part by part.
  Matrix6d rotation = Matrix6d::Zero();
  rotation.topLeftCorner<3, 3>() = rotation.bottomRightCorner<3, 3>() = state.world_T_imu.rotation();
  state.pose_covariance = rotation * joint_.poseCovariance() * rotation.transpose();
  state.twist = held_.twist();
  // The motion noise enters as tau w (eq. 2), so a step's W stands for this variance of the twist.
  state.twist_covariance = (config_.motion_noise / (config_.step_s * config_.step_s)).asDiagonal();
  return state;
}

std::vector<LandmarkEstimate> PaperEstimator::landmarks() const {
  return config_.mode == PaperMode::kMapping ? mapper_.landmarks() : joint_.landmarks();
}

} // namespace vi_ekf_slam::paper

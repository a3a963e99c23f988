#include "vi_ekf_slam/core/paper/paper_estimator.hpp"

namespace vi_ekf_slam::paper {

PaperEstimator::PaperEstimator(const PaperConfig& config) : config_(config), mapper_(config), joint_(config) {
  pose_.covariance = config.prior_pose_variance * Matrix6d::Identity();
}

void PaperEstimator::process(const GyroSample& sample) {
  advanceTo(sample.stamp);
  hold_.setAngular(sample.angular_velocity);
}

void PaperEstimator::process(const VelocitySample& sample) {
  advanceTo(sample.stamp);
  hold_.setLinear(sample.linear_velocity);
}

FrameReport PaperEstimator::process(const StereoFrame& frame) {
  advanceTo(frame.stamp);
  if (rig_ && config_.mode == PaperMode::kMapping) return mapper_.update(*rig_, pose_.imu_T_world, frame);
  if (rig_ && config_.mode == PaperMode::kSlam) return joint_.update(*rig_, frame);
  FrameReport report;
  report.stamp = frame.stamp;
  report.features = frame.features.size();
  report.invalid = config_.mode == PaperMode::kDeadReckoning ? 0 : report.features;
  return report;
}

void PaperEstimator::advanceTo(Stamp stamp) {
  const double tau = hold_.advanceTo(stamp);
  if (!(tau > 0.0)) return;
  const Matrix6d W = (tau / config_.step_s * config_.motion_noise).asDiagonal();
  if (config_.mode == PaperMode::kSlam) {
    joint_.predict(hold_.twist(), tau, W);
  } else {
    predict(hold_.twist(), tau, W, pose_);
  }
}

StateEstimate PaperEstimator::state() const {
  const bool joint = config_.mode == PaperMode::kSlam;
  StateEstimate state;
  state.stamp = hold_.stamp();
  state.world_T_imu = (joint ? joint_.imuTWorld() : pose_.imu_T_world).inverse();
  // U = Exp(delta) U^ means T = T^ Exp(-delta): the error along the world axes is -R delta, part by part.
  Matrix6d rotation = Matrix6d::Zero();
  rotation.topLeftCorner<3, 3>() = state.world_T_imu.rotation();
  rotation.bottomRightCorner<3, 3>() = state.world_T_imu.rotation();
  state.pose_covariance =
      rotation * (joint ? joint_.poseCovariance() : pose_.covariance) * rotation.transpose();
  state.twist = hold_.twist();
  // The motion noise enters as tau w (eq. 2), so a step's W stands for this variance of the twist.
  state.twist_covariance = (config_.motion_noise / (config_.step_s * config_.step_s)).asDiagonal();
  return state;
}

std::vector<LandmarkEstimate> PaperEstimator::landmarks() const {
  return config_.mode == PaperMode::kSlam ? joint_.landmarks() : mapper_.landmarks();
}

} // namespace vi_ekf_slam::paper

#include "vi_ekf_slam/core/slam_system.hpp"

#include <Eigen/Cholesky>
#include <chrono>
#include <string>
#include <utility>

namespace vi_ekf_slam {
namespace {

bool isUsable(const Eigen::Vector3d& value, double max_norm,
              const std::optional<Eigen::Matrix3d>& covariance) {
  if (!(value.norm() <= max_norm)) return false; // nor where it is not finite
  if (!covariance) return true;
  if (!covariance->allFinite()) return false;
  const Eigen::Matrix3d& C = *covariance;
  const double asymmetry = (C - C.transpose()).cwiseAbs().maxCoeff();
  return asymmetry <= 1e-9 * C.cwiseAbs().maxCoeff() && C.llt().info() == Eigen::Success;
}

bool isUsable(const GyroSample& s) { return isUsable(s.angular_velocity, kMaxAngularSpeed, s.covariance); }
bool isUsable(const VelocitySample& s) { return isUsable(s.linear_velocity, kMaxSpeed, s.covariance); }
bool isUsable(const StereoFrame&) { return true; } // features are judged one by one, by the estimator

} // namespace

SlamSystem::SlamSystem(const Config& config)
    : config_(config), buffer_(config.buffer), estimator_(makeEstimator(config)) {}

void SlamSystem::setRig(const StereoRig& rig) {
  rig_ = rig;
  estimator_->setRig(rig);
  drain();
}

void SlamSystem::add(Measurement measurement) {
  const auto stream = static_cast<std::size_t>(streamOf(measurement));
  if (!std::visit([](const auto& sample) { return isUsable(sample); }, measurement)) {
    ++counts_.invalid[stream];
    return;
  }
  const Stamp stamp = stampOf(measurement);
  auto verdict = buffer_.add(measurement);
  if (verdict == MeasurementBuffer::Verdict::kJumpBack) {
    reset("time jumped back by " + std::to_string(secondsBetween(stamp, *buffer_.newest())) + " s");
    verdict = buffer_.add(std::move(measurement));
  }
  if (verdict == MeasurementBuffer::Verdict::kLate) ++counts_.late[stream];
  if (verdict == MeasurementBuffer::Verdict::kDuplicate) ++counts_.duplicate[stream];
  if (!first_stamp_) first_stamp_ = stamp;
  drain();
}

bool SlamSystem::needsRig() const {
  return !(config_.estimator == EstimatorType::kPaper && config_.paper.mode == PaperMode::kDeadReckoning);
}

bool SlamSystem::waitingForRig() const {
  return !rig_ && needsRig() && first_stamp_ && buffer_.newest() &&
         secondsBetween(*first_stamp_, *buffer_.newest()) < config_.rig_wait_s;
}

void SlamSystem::drain() {
  if (waitingForRig()) {
    while (buffer_.size() > config_.buffer.max_size) process(*buffer_.popRegardless());
    return;
  }
  while (auto measurement = buffer_.pop()) process(*measurement);
}

void SlamSystem::flush() {
  while (auto measurement = buffer_.popRegardless()) process(*measurement);
}

void SlamSystem::reset(const std::string& reason) {
  // What was measured before the reset is still due to whoever listens.
  flush();
  buffer_.clear();
  estimator_ = makeEstimator(config_);
  if (rig_) estimator_->setRig(*rig_);
  dead_reckoning_ = DeadReckoning();
  first_stamp_.reset();
  ++counts_.resets;
  if (on_reset_) on_reset_(reason);
}

void SlamSystem::process(const Measurement& measurement) {
  ++counts_.processed[static_cast<std::size_t>(streamOf(measurement))];
  if (const auto* gyro = std::get_if<GyroSample>(&measurement)) {
    estimator_->process(*gyro);
    dead_reckoning_.process(*gyro);
    if (on_gyro_) on_gyro_({estimator_->state(), dead_reckoning_.pose(), {}, 0.0});
  } else if (const auto* velocity = std::get_if<VelocitySample>(&measurement)) {
    estimator_->process(*velocity);
    dead_reckoning_.process(*velocity);
  } else {
    const auto& frame = std::get<StereoFrame>(measurement);
    if (!rig_) ++counts_.frames_without_rig;
    const auto start = std::chrono::steady_clock::now();
    const FrameReport report = estimator_->process(frame);
    const std::chrono::duration<double> update = std::chrono::steady_clock::now() - start;
    dead_reckoning_.advanceTo(frame.stamp);
    counts_.features += report.features;
    counts_.features_invalid += report.invalid;
    counts_.features_used += report.used;
    counts_.features_rejected += report.rejected;
    counts_.frames_rejected += report.frame_rejected ? 1 : 0;
    counts_.landmarks_revisited += report.revisited;
    if (on_frame_) on_frame_({estimator_->state(), dead_reckoning_.pose(), report, update.count()});
  }
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/slam/slam_system.hpp"

#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/paper/paper_estimator.hpp"
#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

namespace vi_ekf_slam {
namespace {

enum class Fault { kNone, kNotFinite, kTooFast, kBadCovariance };

Fault faultOf(const Eigen::Vector3d& value, double max_norm,
              const std::optional<Eigen::Matrix3d>& covariance) {
  if (!value.allFinite()) return Fault::kNotFinite;
  if (!(value.norm() <= max_norm)) return Fault::kTooFast;
  if (!covariance) return Fault::kNone;
  if (!covariance->allFinite()) return Fault::kBadCovariance;
  const Eigen::Matrix3d& C = *covariance;
  const double asymmetry = (C - C.transpose()).cwiseAbs().maxCoeff();
  const bool good = asymmetry <= 1e-9 * C.cwiseAbs().maxCoeff() && isPositiveDefinite(C);
  return good ? Fault::kNone : Fault::kBadCovariance;
}

Fault faultOf(const GyroSample& s) { return faultOf(s.angular_velocity, kMaxAngularSpeed, s.covariance); }
Fault faultOf(const VelocitySample& s) { return faultOf(s.linear_velocity, kMaxSpeed, s.covariance); }
Fault faultOf(const StereoFrame&) { return Fault::kNone; } // features are judged one by one, by the estimator

} // namespace

std::unique_ptr<Estimator> makeEstimator(const Config& config) {
  if (config.estimator == EstimatorType::kInvariant)
    return std::make_unique<InvariantEstimator>(config.invariant);
  return std::make_unique<paper::PaperEstimator>(config.paper);
}

SlamSystem::SlamSystem(const Config& config)
    : config_(config),
      guard_(config.buffer),
      buffer_(config.buffer),
      estimator_(makeEstimator(config)),
      lever_arm_(config.invariant.motion.velocity_sigma, config.invariant.motion.gyro_sigma),
      noise_(config) {}

void SlamSystem::setRig(const StereoRig& rig) {
  rig_ = rig;
  estimator_->setRig(rig);
  drain();
}

void SlamSystem::setBiasPrior(const TwistBias& bias) {
  if (!bias.mean.allFinite() || !bias.sigma.allFinite() || !(bias.sigma.minCoeff() > 0.0))
    throw std::invalid_argument(
        "a bias's mean and standard deviation must be finite, and the latter positive");
  bias_ = bias;
  estimator_->setBiasPrior(bias);
}

bool SlamSystem::countInvalid(const Measurement& measurement) {
  const Fault fault = std::visit([](const auto& sample) { return faultOf(sample); }, measurement);
  if (fault == Fault::kNone) return false;
  const auto stream = static_cast<std::size_t>(streamOf(measurement));
  ++counts_.invalid[stream];
  if (fault == Fault::kTooFast) ++counts_.too_fast[stream];
  if (fault == Fault::kBadCovariance) ++counts_.bad_covariance[stream];
  return true;
}

void SlamSystem::add(Measurement measurement) {
  if (countInvalid(measurement)) return;
  const auto verdict = guard_.judge(measurement, buffer_.newest());
  countStrays();
  if (verdict == ClockGuard::Verdict::kHeld) return;
  if (verdict == ClockGuard::Verdict::kJump) {
    followJump();
  } else {
    buffer(std::move(measurement));
  }
  drain();
}

void SlamSystem::buffer(Measurement measurement) {
  const auto stream = static_cast<std::size_t>(streamOf(measurement));
  const Stamp stamp = stampOf(measurement);
  using Verdict = MeasurementBuffer::Verdict;
  const Verdict verdict = buffer_.add(std::move(measurement));
  if (verdict == Verdict::kDuplicate) ++counts_.duplicate[stream];
  // A jump back is within what confirmed a jump; the guard keeps others away.
  if (verdict == Verdict::kLate || verdict == Verdict::kJumpBack) ++counts_.late[stream];
  if (verdict != Verdict::kJumpBack && !first_stamp_) first_stamp_ = stamp;
}

/// A gap is driven through; what is longer, and any way back, is a new start.
void SlamSystem::followJump() {
  std::vector<Measurement> measurements = guard_.take();
  const double ahead = secondsBetween(*buffer_.newest(), stampOf(measurements.front()));
  const bool is_gap = ahead > 0.0 && ahead <= config_.buffer.max_gap_s;
  if (is_gap && estimator_->canBridge(ahead)) {
    ++counts_.gaps;
  } else {
    reset(std::string("time jumped ") + (ahead > 0.0 ? "ahead" : "back") + " by " +
          std::to_string(std::abs(ahead)) + " s" + (is_gap ? ", after which the heading is not known" : ""));
  }
  for (Measurement& measurement : measurements) buffer(std::move(measurement));
}

void SlamSystem::countStrays() {
  counts_.ahead = guard_.strays().ahead;
  counts_.behind = guard_.strays().behind;
}

bool SlamSystem::needsRig() const {
  return !(config_.estimator == EstimatorType::kPaper && config_.paper.mode == PaperMode::kDeadReckoning);
}

void SlamSystem::drain() {
  const bool waits_for_rig = !rig_ && needsRig() && first_stamp_ && buffer_.newest() &&
                             secondsBetween(*first_stamp_, *buffer_.newest()) < config_.rig_wait_s;
  if (waits_for_rig) {
    while (buffer_.size() > config_.buffer.max_size) process(*buffer_.popRegardless());
  } else {
    while (auto measurement = buffer_.pop()) process(*measurement);
  }
}

void SlamSystem::flush() {
  guard_.discard();
  countStrays();
  while (auto measurement = buffer_.popRegardless()) process(*measurement);
}

void SlamSystem::setGates(const Gates& gates) {
  config_.invariant.setGates(gates);
  estimator_->setGates(gates);
}

void SlamSystem::reset(const std::string& reason) {
  // What was measured before the reset is still due to whoever listens.
  flush();
  buffer_.clear();
  estimator_ = makeEstimator(config_);
  if (rig_) estimator_->setRig(*rig_);
  if (bias_) estimator_->setBiasPrior(*bias_);
  if (loaded_map_) estimator_->relocaliseIn(loaded_map_);
  dead_reckoning_ = DeadReckoning();
  lever_arm_.restart();
  first_stamp_.reset();
  blindness_.restart();
  ++counts_.resets;
  if (handlers_.reset) handlers_.reset(reason);
}

void SlamSystem::requireJointMap(const std::string& source) const {
  if (estimator_->keepsJointMap()) return;
  throw MapError(
      source +
      ": the configured estimator has no use for a map; estimator: invariant with map.keep: good or all has");
}

void SlamSystem::loadMap(std::shared_ptr<const SavedMap> map, const std::string& source) {
  requireJointMap(source);
  loaded_map_ = std::move(map);
  if (first_stamp_) {
    reset("map loaded from " + source);
  } else {
    estimator_->relocaliseIn(loaded_map_);
  }
}

void SlamSystem::resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source) {
  requireJointMap(source);
  estimator_->resumeFrom(std::move(map), source, config_.buffer.max_gap_s);
}

void SlamSystem::process(const Measurement& measurement) {
  // Features are not used before the calibration is known.
  const bool is_used = !std::holds_alternative<StereoFrame>(measurement) || (rig_ && needsRig());
  const auto news = is_used ? noise_.note(measurement) : std::nullopt;
  if (news && handlers_.noise) handlers_.noise(*news);
  ++counts_.processed[static_cast<std::size_t>(streamOf(measurement))];
  if (needsRig()) blindness_.advanceTo(stampOf(measurement));
  counts_.blind_s = blindness_.total();
  counts_.blind_periods = blindness_.periods();
  if (const auto* gyro = std::get_if<GyroSample>(&measurement)) {
    lever_arm_.note(*gyro);
    estimator_->process(*gyro);
    dead_reckoning_.process(*gyro);
    if (handlers_.gyro) handlers_.gyro({estimator_->state(), dead_reckoning_.pose(), {}, 0.0});
  } else if (const auto* velocity = std::get_if<VelocitySample>(&measurement)) {
    const VelocitySample at_imu = lever_arm_.atImu(*velocity);
    estimator_->process(at_imu);
    dead_reckoning_.process(at_imu);
  } else {
    const auto& frame = std::get<StereoFrame>(measurement);
    if (!rig_) ++counts_.frames_without_rig;
    const auto start = std::chrono::steady_clock::now();
    const FrameReport report = estimator_->process(frame);
    const std::chrono::duration<double> update = std::chrono::steady_clock::now() - start;
    dead_reckoning_.advanceTo(frame.stamp);
    count(report);
    if (handlers_.frame)
      handlers_.frame({estimator_->state(), dead_reckoning_.pose(), report, update.count()});
  }
}

void SlamSystem::count(const FrameReport& report) {
  counts_.features += report.features;
  counts_.features_invalid += report.invalid;
  counts_.features_used += report.used;
  counts_.features_rejected += report.rejected;
  counts_.frames_rejected += report.frame_rejected ? 1 : 0;
  counts_.landmarks_revisited += report.revisited;
  counts_.places_recognised += report.place_recognised ? 1 : 0;
  counts_.relocalisations += report.relocalised ? 1 : 0;
  if (report.divergence != Divergence::kNone)
    ++counts_.divergences[static_cast<std::size_t>(report.divergence)];
  if (report.used > 0) blindness_.noteUse();
}

} // namespace vi_ekf_slam

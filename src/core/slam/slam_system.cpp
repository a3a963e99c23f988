#include "vi_ekf_slam/core/slam/slam_system.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/paper/paper_estimator.hpp"
#include "vi_ekf_slam/core/slam/inertial_estimator.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFirstWait = 1.0; // s of sensor time for first messages of the IMU, and for biases told

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

Fault faultOf(const ImuSample& s) {
  const Fault gyro = faultOf(s.angular_velocity, kMaxAngularSpeed, s.covariance);
  if (gyro != Fault::kNone || !s.acceleration) return gyro;
  return faultOf(*s.acceleration, kMaxAcceleration, s.acceleration_covariance);
}
Fault faultOf(const VelocitySample& s) { return faultOf(s.linear_velocity, kMaxSpeed, s.covariance); }
Fault faultOf(const StereoFrame&) { return Fault::kNone; } // features are judged one by one, by the estimator

std::string withoutNumbers(std::string text) {
  const auto is_digit = [](char c) { return (c >= '0' && c <= '9') || c == '.'; };
  text.erase(std::remove_if(text.begin(), text.end(), is_digit), text.end());
  return text;
}

} // namespace

std::unique_ptr<Estimator> makeEstimator(const Config& config) {
  if (config.estimator == EstimatorType::kPaper) return std::make_unique<paper::PaperEstimator>(config.paper);
  if (config.invariant.choice == MotionChoice::kInertial)
    return std::make_unique<InertialEstimator>(config.invariant);
  return std::make_unique<InvariantEstimator>(config.invariant);
}

SlamSystem::SlamSystem(const Config& config)
    : config_(config),
      motion_(config.estimator == EstimatorType::kPaper ? MotionChoice::kConstantTwist
                                                        : config.invariant.choice),
      guard_(config.buffer),
      buffer_(config.buffer),
      estimator_(vi_ekf_slam::makeEstimator(config)),
      lever_arm_(config.invariant.motion.velocity_sigma, config.invariant.motion.gyro_sigma),
      noise_(config),
      imu_check_(config.invariant.inertial.gravity),
      motion_check_(config.invariant) {
  noise_.setInertial(motion_ == MotionChoice::kInertial);
  if (motion_ != MotionChoice::kAuto && config.estimator != EstimatorType::kPaper)
    motion_text_ = motion_ == MotionChoice::kInertial ? "inertial, configured" : "constant twist, configured";
}

std::unique_ptr<Estimator> SlamSystem::makeEstimator() const {
  Config config = config_;
  config.invariant.choice = motion_;
  auto estimator = vi_ekf_slam::makeEstimator(config);
  if (rig_) estimator->setRig(*rig_);
  if (bias_) estimator->setBiasPrior(*bias_);
  if (loaded_map_) estimator->relocaliseIn(loaded_map_);
  return estimator;
}

/// Nothing has been processed yet.
void SlamSystem::choose(MotionChoice motion, const std::string& reason) {
  motion_ = motion;
  noise_.setInertial(motion == MotionChoice::kInertial);
  if (motion == MotionChoice::kInertial) estimator_ = makeEstimator();
  motion_text_ = (motion == MotionChoice::kInertial ? "inertial, " : "constant twist, ") + reason;
  if (handlers_.start) handlers_.start("motion: " + motion_text_);
}

void SlamSystem::chooseBy(const ImuSample& sample) {
  if (!sample.acceleration)
    return choose(MotionChoice::kConstantTwist,
                  "the IMU's messages carry no acceleration (all are 0, or said not to be measured)");
  if (const std::optional<bool> is_fast = imu_rate_.suffices(sample.stamp))
    *is_fast ? choose(MotionChoice::kInertial, "the IMU's messages carry accelerations") : chooseWithout();
}

/// Without accelerations.
void SlamSystem::chooseWithout() {
  choose(MotionChoice::kConstantTwist,
         imu_rate_.hasSamples() ? "the IMU's messages come at less than 50 Hz, too seldom for their "
                                  "accelerations to be integrated (motion: inertial does it none the less)"
                                : "there is no IMU");
}

void SlamSystem::begin(const InitialState& state) {
  if (motion_ == MotionChoice::kConstantTwist)
    throw ConfigError(
        "an initial state is of no use to this configuration, whose motion is a constant twist: it needs "
        "motion: inertial or auto");
  if (motion_ == MotionChoice::kAuto) choose(MotionChoice::kInertial, "to go on from an initial state");
  estimator_->begin(state);
}

void SlamSystem::setRig(const StereoRig& rig) {
  rig_ = config_.invariant.rig.appliedTo(rig);
  estimator_->setRig(*rig_);
  motion_check_.setRig(*rig_);
  drain();
}

void SlamSystem::setBiasPrior(const TwistBias& bias) {
  if (!bias.mean.allFinite() || !bias.sigma.allFinite() || !(bias.sigma.minCoeff() > 0.0))
    throw std::invalid_argument(
        "a bias's mean and standard deviation must be finite, and the latter positive");
  bias_ = bias;
  bias_awaited_ = false;
  estimator_->setBiasPrior(bias);
  drain();
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
  if (const auto* imu = std::get_if<ImuSample>(&measurement); imu && motion_ == MotionChoice::kAuto)
    chooseBy(*imu);
  if (auto* frame = std::get_if<StereoFrame>(&measurement)) {
    frame->time_offset = estimator_->timeOffset();
    frame->stamp += fromSeconds(frame->time_offset);
  }
  const auto verdict = guard_.judge(measurement, buffer_.newest());
  countStrays();
  if (verdict == ClockGuard::Verdict::kHeld) return;
  if (verdict == ClockGuard::Verdict::kJump) {
    followJump();
  } else {
    if (const auto* imu = std::get_if<ImuSample>(&measurement)) imu_check_.arrived(imu->stamp);
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

/// For the calibration, for the first messages of the IMU, which say how the body moves, and for what is
/// known of its biases.
bool SlamSystem::waits() const {
  if (!first_stamp_ || !buffer_.newest()) return false;
  const double held = secondsBetween(*first_stamp_, *buffer_.newest());
  return (!rig_ && needsRig() && held < config_.rig_wait_s) ||
         ((motion_ == MotionChoice::kAuto || bias_awaited_) &&
          held < config_.buffer.max_delay_s + kFirstWait);
}

void SlamSystem::drain() {
  const bool is_full = buffer_.size() > config_.buffer.max_size;
  if (motion_ == MotionChoice::kAuto && buffer_.newest() && (is_full || !waits())) chooseWithout();
  if (waits()) {
    while (buffer_.size() > config_.buffer.max_size) process(*buffer_.popRegardless());
  } else {
    while (auto measurement = buffer_.pop()) process(*measurement);
  }
}

void SlamSystem::flush() {
  if (motion_ == MotionChoice::kAuto && !buffer_.empty()) chooseWithout();
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
  first_stamp_.reset();
  beginAnew(reason);
}

void SlamSystem::beginAnew(const std::string& reason) {
  const PathEstimate path = handlers_.reset ? estimator_->path() : PathEstimate();
  estimator_ = makeEstimator();
  told_starts_.clear();
  imu_check_.restart();
  motion_check_.restart();
  dead_reckoning_ = DeadReckoning();
  lever_arm_.restart();
  blindness_.restart();
  ++counts_.resets;
  if (handlers_.reset) handlers_.reset(reason, path);
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
  if (is_used) {
    for (const StreamNoise& news : noise_.note(measurement)) {
      if (handlers_.noise) handlers_.noise(news);
    }
  }
  ++counts_.processed[static_cast<std::size_t>(streamOf(measurement))];
  if (const ImuSample* next = buffer_.nextImu()) estimator_->expect(*next);
  if (needsRig()) blindness_.advanceTo(stampOf(measurement));
  counts_.blind_s = blindness_.total();
  counts_.blind_periods = blindness_.periods();
  if (const auto* gyro = std::get_if<ImuSample>(&measurement)) {
    imu_check_.note(*gyro, motion_ == MotionChoice::kInertial);
    lever_arm_.note(*gyro);
    // An inertial estimate that has started has compared the two.
    if (motion_ != MotionChoice::kInertial || !estimator_->hasStarted()) motion_check_.note(*gyro);
    estimator_->process(*gyro);
    if (!estimator_->hasStarted()) return;
    const StateEstimate state = estimator_->state();
    updateDeadReckoning(*gyro, state);
    if (handlers_.gyro) handlers_.gyro({state, dead_reckoning_.pose(), {}, 0.0});
  } else if (const auto* velocity = std::get_if<VelocitySample>(&measurement)) {
    const VelocitySample at_imu = lever_arm_.atImu(*velocity);
    motion_check_.note(at_imu);
    estimator_->process(at_imu);
    if (motion_ != MotionChoice::kInertial) updateDeadReckoning(at_imu, estimator_->state());
  } else {
    const auto& frame = std::get<StereoFrame>(measurement);
    imu_check_.noteFrame(frame.stamp);
    if (!rig_) ++counts_.frames_without_rig;
    checkMotion(frame);
    const auto start = std::chrono::steady_clock::now();
    const FrameReport report = estimator_->process(frame);
    const std::chrono::duration<double> update = std::chrono::steady_clock::now() - start;
    count(report);
    if (const std::string reason = estimator_->contradiction(); !reason.empty()) return beginAnew(reason);
    reportStart();
    if (!estimator_->hasStarted()) {
      ++counts_.frames_before_start;
      return;
    }
    const StateEstimate state = estimator_->state();
    updateDeadReckoning(frame, state);
    if (handlers_.frame)
      handlers_.frame({state, dead_reckoning_.pose(), report, update.count(), estimator_->closedLoop()});
  }
}

void SlamSystem::checkMotion(const StereoFrame& frame) {
  if (config_.estimator == EstimatorType::kPaper) return; // the baseline takes all as it is
  const std::string problem = motion_check_.note(frame);
  if (!problem.empty() && handlers_.problem) handlers_.problem(problem);
}

/// Of what is measured; where no velocity is, of the estimated twist, which is smooth but for small steps of
/// what it is a derivative of.
void SlamSystem::updateDeadReckoning(const Measurement& measurement, const StateEstimate& state) {
  const bool is_inertial = motion_ == MotionChoice::kInertial;
  if (!dead_reckoning_.stamp()) dead_reckoning_.begin(estimator_->startPose().value_or(state.world_T_imu));
  if (!is_inertial && counts_.processed[static_cast<std::size_t>(Stream::kVelocity)] > 0) {
    if (const auto* gyro = std::get_if<ImuSample>(&measurement)) return dead_reckoning_.process(*gyro);
    if (const auto* velocity = std::get_if<VelocitySample>(&measurement))
      return dead_reckoning_.process(*velocity);
    return dead_reckoning_.advanceTo(stampOf(measurement));
  }
  dead_reckoning_.setTwist(stampOf(measurement), state.twist);
}

void SlamSystem::reportStart() {
  const std::string problem = estimator_->startProblem();
  if (!told_starts_.insert(withoutNumbers(problem)).second || !handlers_.start) return;
  // An estimator that needs no start does not tell of one.
  if (!problem.empty()) {
    handlers_.start("not started: " + problem);
  } else if (motion_ == MotionChoice::kInertial) {
    handlers_.start("started");
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

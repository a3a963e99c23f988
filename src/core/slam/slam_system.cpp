#include "vi_ekf_slam/core/slam/slam_system.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/loops/relocaliser.hpp"
#include "vi_ekf_slam/core/map/snapshot.hpp"
#include "vi_ekf_slam/core/paper/paper_estimator.hpp"
#include "vi_ekf_slam/core/slam/inertial_estimator.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFirstWait = 1.0; // s of sensor time for first messages of the IMU, and for biases told
// s without any measurement, after which every estimate is good enough to go on.
constexpr double kShortestGap = 0.4;
constexpr const char* kLost = ", after which the orientation is not known";
constexpr const char* kOtherRig =
    "the calibration begins as it is given: the map's corrections are of another one, or say not of which";
constexpr double kVelocityHolds = 2.0; // s; of one that stopped coming nothing is reckoned on

std::uint64_t total(const std::array<std::uint64_t, kStreamCount>& counts) {
  return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
}

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
      motion_(config),
      arrivals_(config.buffer),
      estimator_(vi_ekf_slam::makeEstimator(config)),
      lever_arm_(config.invariant.motion.velocity_sigma, config.invariant.motion.gyro_sigma),
      checks_{NoiseReport(config), ImuCheck(config.invariant.inertial.gravity),
              MotionCheck(config.invariant)} {
  checks_.noise.setInertial(motion_.isInertial());
  motion_.onDecision([this] { adoptMotion(); });
}

std::unique_ptr<Estimator> SlamSystem::makeEstimator() const {
  Config config = config_;
  config.invariant.choice = motion_.choice();
  auto estimator = vi_ekf_slam::makeEstimator(config);
  if (given_.rig) estimator->setRig(*given_.rig);
  if (given_.bias) estimator->setBiasPrior(*given_.bias);
  if (given_.map) estimator->relocaliseIn(given_.map);
  return estimator;
}

/// Nothing has been processed yet, unless the IMU is late.
void SlamSystem::adoptMotion() {
  checks_.noise.setInertial(motion_.isInertial());
  if (total(counts_.processed) > 0)
    reset("an IMU with accelerations has come");
  else if (motion_.isInertial())
    estimator_ = makeEstimator();
  if (handlers_.start) handlers_.start("motion: " + motion_.text());
}

void SlamSystem::begin(const InitialState& state) {
  if (motion_.choice() == MotionChoice::kConstantTwist)
    throw ConfigError(
        "an initial state is of no use to this configuration, whose motion is a constant twist: it needs "
        "motion: inertial or auto");
  motion_.decide(MotionChoice::kInertial, "to go on from an initial state");
  estimator_->begin(state);
}

void SlamSystem::setRig(const StereoRig& rig) {
  given_.rig = config_.invariant.rig.appliedTo(rig);
  estimator_->setRig(*given_.rig);
  checks_.motion.setRig(*given_.rig);
  if (given_.resumes && !correctsRig(*given_.map, given_.rig) && handlers_.start) handlers_.start(kOtherRig);
  drain();
}

void SlamSystem::setBiasPrior(const TwistBias& bias) {
  if (!bias.mean.allFinite() || !bias.sigma.allFinite() || !(bias.sigma.minCoeff() > 0.0))
    throw std::invalid_argument(
        "a bias's mean and standard deviation must be finite, and the latter positive");
  given_.bias = bias;
  given_.bias_awaited = false;
  estimator_->setBiasPrior(bias);
  drain();
}

void SlamSystem::add(Measurement measurement) {
  if (!arrivals_.isValid(measurement)) return;
  if (const auto* imu = std::get_if<ImuSample>(&measurement)) motion_.note(*imu);
  if (auto* frame = std::get_if<StereoFrame>(&measurement)) {
    frame->time_offset = estimator_->timeOffset();
    frame->stamp += fromSeconds(frame->time_offset);
  }
  const Stream stream = streamOf(measurement);
  const Stamp stamp = stampOf(measurement);
  const Arrivals::Verdict verdict = arrivals_.add(std::move(measurement));
  if (verdict == Arrivals::Verdict::kHeld) return;
  if (verdict == Arrivals::Verdict::kJump) {
    followJump();
  } else if (stream == Stream::kImu) {
    checks_.imu.arrived(stamp);
  }
  drain();
}

/// A gap is driven through; what is longer, and any way back, is a new start.
void SlamSystem::followJump() {
  const double ahead = arrivals_.jump();
  const bool is_gap = ahead > 0.0 && ahead <= config_.buffer.max_gap_s;
  if (is_gap && estimator_->canBridge(ahead)) {
    ++counts_.gaps;
  } else {
    const std::string reason = std::string("time jumped ") + (ahead > 0.0 ? "ahead" : "back") + " by " +
                               std::to_string(std::abs(ahead)) + " s" + (is_gap ? kLost : "");
    if (ahead > 0.0) {
      endInput();
      beginAfterGap(reason);
    } else {
      reset(reason);
    }
  }
  arrivals_.goOn();
}

/// The time until `now`, in which nothing was measured.
void SlamSystem::bridge(Stamp now) {
  const std::optional<Stamp> before = std::exchange(reached_, now);
  const double gap = before ? secondsBetween(*before, now) : 0.0;
  if (gap > kShortestGap && !estimator_->canBridge(gap)) {
    beginAfterGap("no message for " + std::to_string(gap) + " s" + kLost);
    reached_ = now;
  }
}

/// Frames without features tell nothing, and without a gyro the orientation is lost meanwhile, whatever else
/// comes.
void SlamSystem::seeAgain(const StereoFrame& frame) {
  if (frame.features.empty()) return;
  const std::optional<Stamp> before = std::exchange(seen_, frame.stamp);
  const double blind = before ? secondsBetween(*before, frame.stamp) : 0.0;
  if (blind > kShortestGap && !estimator_->canBridge(0.0))
    beginAfterGap("no feature for " + std::to_string(blind) + " s" + kLost);
}

/// The world is as it was, and the body where it may have got to.
void SlamSystem::beginAfterGap(const std::string& reason) {
  auto map = mapOfBefore();
  const Forecast forecast = estimator_->forecast();
  beginAnew(reason);
  estimator_->beginAt(forecast);
  if (map) estimator_->relocaliseIn(map);
  before_gap_ = std::move(map);
}

bool SlamSystem::needsRig() const {
  return !(config_.estimator == EstimatorType::kPaper && config_.paper.mode == PaperMode::kDeadReckoning);
}

/// For the calibration, for the first messages of the IMU, which say how the body moves, and for what is
/// known of its biases.
bool SlamSystem::waits() const {
  const std::optional<double> held = arrivals_.duration();
  if (!held) return false;
  return (!given_.rig && needsRig() && *held < config_.rig_wait_s) ||
         ((motion_.isOpen() || given_.bias_awaited) && *held < config_.buffer.max_delay_s + kFirstWait);
}

void SlamSystem::drain() {
  if (arrivals_.newest() && (arrivals_.isOverfull() || !waits())) motion_.close();
  if (waits()) {
    while (arrivals_.isOverfull()) process(*arrivals_.popRegardless());
  } else {
    while (auto measurement = arrivals_.pop()) process(*measurement);
  }
}

void SlamSystem::flush() {
  if (!arrivals_.empty()) motion_.close();
  arrivals_.close();
  while (auto measurement = arrivals_.popRegardless()) process(*measurement);
}

void SlamSystem::setGates(const Gates& gates) {
  config_.invariant.setGates(gates);
  estimator_->setGates(gates);
}

/// What was measured before a reset is still due to whoever listens; where it is not known yet how the body
/// moves, nothing has come of it.
void SlamSystem::endInput() {
  if (!motion_.isOpen()) flush();
  arrivals_.close();
  arrivals_.clear();
}

void SlamSystem::reset(const std::string& reason) {
  endInput();
  if (auto map = keeps_map_ ? mapOfBefore() : nullptr) given_.map = std::move(map);
  beginAnew(reason);
}

/// In which a place can be found; the one of before a gap where that is still looked for.
std::shared_ptr<const SavedMap> SlamSystem::mapOfBefore() const {
  if (estimator_->mapUse() == MapUse::kWaiting) return before_gap_;
  const auto saved = estimator_->savedMap();
  auto map = saved ? std::make_shared<const SavedMap>(saved()) : nullptr;
  return map && map->landmarks.size() >= Relocaliser::kLeastMatches ? map : nullptr;
}

void SlamSystem::beginAnew(const std::string& reason) {
  if (handlers_.map_end) handlers_.map_end(estimator_->savedMap());
  const PathEstimate path = handlers_.reset ? estimator_->path() : PathEstimate();
  estimator_ = makeEstimator();
  before_gap_.reset();
  told_starts_.clear();
  reached_.reset();
  seen_.reset();
  checks_.imu.restart();
  checks_.motion.restart();
  dead_reckoning_ = DeadReckoning();
  last_velocity_.reset();
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
  const bool has_begun = arrivals_.newest().has_value();
  if (has_begun) endInput();
  given_.map = std::move(map);
  if (has_begun) {
    beginAnew("map loaded from " + source);
  } else {
    estimator_->relocaliseIn(given_.map);
  }
}

void SlamSystem::resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source) {
  requireJointMap(source);
  const auto has = [&map](const char* name) {
    return std::any_of(map->variables.begin(), map->variables.end(),
                       [name](const SavedVariable& v) { return v.name == name; });
  };
  const bool is_inertial = has(Inertial::kVelocity) && has(Inertial::kAccelerometerBias);
  if (is_inertial || has(ConstantTwist::kTwist))
    motion_.decide(is_inertial ? MotionChoice::kInertial : MotionChoice::kConstantTwist,
                   "as the saved map that it goes on from has it");
  estimator_->resumeFrom(map, source, config_.buffer.max_gap_s);
  given_.map = std::move(map);
  given_.resumes = true;
}

void SlamSystem::process(const Measurement& measurement) {
  // Features are not used before the calibration is known.
  const bool is_used = !std::holds_alternative<StereoFrame>(measurement) || (given_.rig && needsRig());
  if (is_used) {
    for (const StreamNoise& news : checks_.noise.note(measurement)) {
      if (handlers_.noise) handlers_.noise(news);
    }
  }
  ++counts_.processed[static_cast<std::size_t>(streamOf(measurement))];
  bridge(stampOf(measurement));
  if (const ImuSample* next = arrivals_.nextImu()) estimator_->expect(*next);
  if (needsRig()) blindness_.advanceTo(stampOf(measurement));
  counts_.blind_s = blindness_.total();
  counts_.blind_periods = blindness_.periods();
  std::visit([this](const auto& sample) { process(sample); }, measurement);
}

void SlamSystem::process(const ImuSample& sample) {
  checks_.imu.note(sample, motion_.isInertial());
  checks_.motion.note(sample);
  lever_arm_.note(sample);
  estimator_->process(sample);
  if (!estimator_->hasStarted()) return;
  const StateEstimate state = estimator_->state();
  updateDeadReckoning(sample, state);
  if (handlers_.gyro) handlers_.gyro({state, dead_reckoning_.pose(), {}, 0.0});
}

void SlamSystem::process(const VelocitySample& sample) {
  const VelocitySample at_imu = lever_arm_.atImu(sample);
  checks_.motion.note(at_imu);
  estimator_->process(at_imu);
  if (!motion_.isInertial()) updateDeadReckoning(at_imu, estimator_->state());
}

void SlamSystem::process(const StereoFrame& frame) {
  seeAgain(frame);
  if (!given_.rig) ++counts_.frames_without_rig;
  checks_.imu.noteFrame(frame.stamp);
  // The baseline takes all as it is.
  if (config_.estimator != EstimatorType::kPaper) tellProblem(checks_.motion.note(frame));
  const auto start = std::chrono::steady_clock::now();
  const FrameReport report = estimator_->process(frame);
  const std::chrono::duration<double> update = std::chrono::steady_clock::now() - start;
  count(report);
  tellProblem(checks_.motion.note(report));
  if (const std::string reason = estimator_->contradiction(); !reason.empty()) return beginAnew(reason);
  reportStart();
  if (!estimator_->hasStarted()) {
    ++counts_.frames_before_start;
    return;
  }
  const StateEstimate state = estimator_->state();
  updateDeadReckoning(frame, state);
  if (handlers_.frame)
    handlers_.frame({state, dead_reckoning_.pose(), report, update.count(), estimator_->closedLoop(),
                     frame.stamp - fromSeconds(frame.time_offset)});
}

/// Of what is measured; where no velocity is, of the estimated twist, which is smooth but for small steps of
/// what it is a derivative of.
void SlamSystem::updateDeadReckoning(const Measurement& measurement, const StateEstimate& state) {
  if (!dead_reckoning_.stamp()) dead_reckoning_.begin(estimator_->startPose().value_or(state.world_T_imu));
  const Stamp now = stampOf(measurement);
  if (std::holds_alternative<VelocitySample>(measurement)) last_velocity_ = now;
  if (!motion_.isInertial() && last_velocity_ && secondsBetween(*last_velocity_, now) < kVelocityHolds)
    std::visit([this](const auto& sample) { dead_reckoning_.process(sample); }, measurement);
  else
    dead_reckoning_.setTwist(now, state.twist);
}

void SlamSystem::reportStart() {
  const std::string problem = estimator_->startProblem();
  if (!told_starts_.insert(withoutNumbers(problem)).second || !handlers_.start) return;
  // An estimator that needs no start does not tell of one.
  if (!problem.empty()) {
    handlers_.start("not started: " + problem);
  } else if (motion_.isInertial()) {
    handlers_.start("started");
  }
}

void SlamSystem::tellProblem(const std::string& problem) const {
  if (!problem.empty() && handlers_.problem) handlers_.problem(problem);
}

void SlamSystem::count(const FrameReport& report) {
  counts_.features += report.features;
  counts_.features_invalid += report.invalid;
  counts_.features_used += report.used;
  counts_.features_rejected += report.rejected;
  counts_.velocities_contradicting += report.contradicting_velocities;
  counts_.frames_rejected += report.frame_rejected ? 1 : 0;
  counts_.landmarks_revisited += report.revisited;
  counts_.places_recognised += report.place_recognised ? 1 : 0;
  counts_.relocalisations += report.relocalised ? 1 : 0;
  if (report.divergence != Divergence::kNone)
    ++counts_.divergences[static_cast<std::size_t>(report.divergence)];
  if (report.used > 0) blindness_.noteUse();
}

} // namespace vi_ekf_slam

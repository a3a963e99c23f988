#include "vi_ekf_slam/core/slam/inertial_estimator.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

// s of poses: over less any steady error of the accelerometer passes for gravity and velocity.
constexpr double kShortestStart = 1.0;
constexpr double kLongestStart = 2.0;  // s; what is older is forgotten
constexpr double kKnownTilt = 0.05;    // rad, standard deviation with which the filter may begin
constexpr double kLargestMisfit = 3.0; // of the positions, in standard deviations
constexpr double kSigmas = 4.0;
constexpr double kGravityTolerance =
    0.2; // m/s^2: gravity's own range on Earth is 0.05, an accelerometer's scale 1 %
constexpr double kLargestRejection = 0.25; // of the features that the filter begins with
constexpr std::size_t kUsedFeatures = 8;   // of a frame whose pose counts
constexpr double kLongestBlindness = 0.5;  // s; what is seen after it is not known to be near what was before
constexpr double kLeastSigma = 1e-3;       // m, of a pose: what front ends do wrong together
// s. Over it a hand's 20 rad/s^2 turn a picture by 0.04 mrad more than what is linear in it, a small part of
// a pixel.
constexpr double kLinearClock = 0.002;
constexpr double kLearnt = 1.0 / 3.0; // of a prior's sigma: what is left of one that hardly counts any more
// Wide beside what a start is known to, narrow enough for the filter to be linear there.
constexpr double kStartTilt = 0.2;     // rad
constexpr double kStartVelocity = 1.0; // m/s
constexpr double kAnchored = 1e-6;     // m, rad: the map begins there
// What a hand carries through a room sees the same view every few seconds.
constexpr std::size_t kKeptOneIn = 4;

/// The body as the pictures have it, its position known as they have it.
SeenPose seenPose(Stamp stamp, const StateEstimate& state) {
  return {stamp, state.world_T_imu, state.pose_covariance.diagonal().head<3>().cwiseSqrt()};
}

/// By the clock of the pictures that is known now.
void moveTo(double time_offset, StereoFrame& frame) {
  frame.stamp += fromSeconds(time_offset) - fromSeconds(frame.time_offset);
  frame.time_offset = time_offset;
}

/// Odometry with a hand's or a drone's accelerations.
InvariantConfig odometryConfig(InvariantConfig config) {
  config.choice = MotionChoice::kConstantTwist;
  config.map.keep = MapKeep::kNone;
  config.slip = {0.0, 0.0, 1.0}; // which over so short a way is a scale that nothing else tells
  config.motion.twist_density << 5.0, 5.0, 5.0, 5.0, 5.0, 5.0;
  config.motion.prior_bias_sigma.tail<3>().setConstant(config.inertial.gyro_bias_sigma);
  return config;
}

} // namespace

InertialEstimator::InertialEstimator(const InvariantConfig& config)
    : config_(config),
      odometry_(odometryConfig(config)),
      imu_(config.inertial.noise, config.inertial.noise_given),
      problem_("waits for frames") {
  config_.choice = MotionChoice::kInertial;
  config_.map.one_in = kKeptOneIn;
}

std::unique_ptr<InvariantEstimator> InertialEstimator::makeFilter() const {
  auto filter = std::make_unique<InvariantEstimator>(config_);
  if (bias_) filter->setBiasPrior(*bias_);
  if (rig_) filter->setRig(*rig_);
  return filter;
}

void InertialEstimator::beginOdometry() {
  odometry_.emplace(odometryConfig(config_));
  if (bias_) odometry_->setBiasPrior(*bias_);
  if (rig_) odometry_->setRig(*rig_);
  poses_.clear();
}

void InertialEstimator::setRig(const StereoRig& rig) {
  rig_ = rig;
  if (filter_) filter_->setRig(rig);
  if (odometry_) odometry_->setRig(rig);
}

void InertialEstimator::setBiasPrior(const TwistBias& bias) {
  bias_ = bias;
  if (filter_) filter_->setBiasPrior(bias);
  if (odometry_) odometry_->setBiasPrior(bias);
}

void InertialEstimator::setGates(const Gates& gates) {
  config_.setGates(gates);
  if (filter_) filter_->setGates(gates);
  if (odometry_) odometry_->setGates(gates);
}

bool InertialEstimator::begin(const InitialState& state) {
  if (filter_) return false;
  given_ = state;
  return true;
}

void InertialEstimator::expect(const ImuSample& next) {
  if (filter_) filter_->expect(next);
}

/// From what was saved or given.
void InertialEstimator::tryToGoOn(Stamp now) {
  if (filter_) return;
  if (resuming_ && resuming_->resumeAt(now)) {
    filter_ = std::move(resuming_);
    return;
  }
  if (std::exchange(resuming_, nullptr)) map_ = resume_map_;
  tryGiven(now);
}

/// With the first measurement that is not older than a given state the filter is there.
void InertialEstimator::tryGiven(Stamp now) {
  if (!given_ || now < given_->stamp) return;
  auto filter = makeFilter();
  const InitialState state = *std::exchange(given_, std::nullopt);
  const double gap = secondsBetween(state.stamp, now);
  filter->begin(state);
  filter->preset(imu_);
  if (!filter->canBridge(gap)) {
    problem_ = "the given state is " + rounded(gap) + " s older than the first measurement";
    return;
  }
  if (map_) filter->relocaliseIn(map_);
  filter_ = std::move(filter);
  odometry_.reset();
  window_.clear();
}

void InertialEstimator::process(const ImuSample& sample) {
  tryToGoOn(sample.stamp);
  if (filter_) return filter_->process(sample);
  imu_.reach(sample);
  if (given_) return;
  window_.emplace_back(sample);
  if (!poses_.empty()) odometry_->process(sample); // which begins with a frame
  forgetOld(sample.stamp);
}

void InertialEstimator::process(const VelocitySample& sample) {
  tryToGoOn(sample.stamp);
  if (filter_) return filter_->process(sample);
  if (given_) return;
  window_.emplace_back(sample);
  if (!poses_.empty()) odometry_->process(sample);
}

FrameReport InertialEstimator::process(const StereoFrame& frame) {
  tryToGoOn(frame.stamp);
  if (filter_) return filter_->process(frame);
  if (given_) return FrameReport(frame);
  StereoFrame moved = frame; // of the clock that was known when it came
  moveTo(config_.rig.time_offset, moved);
  window_.emplace_back(moved);
  FrameReport report = odometry_->process(frame);
  const bool is_blind =
      poses_.empty() || secondsBetween(poses_.back().stamp, frame.stamp) > kLongestBlindness;
  if (report.divergence != Divergence::kNone || (is_blind && report.used < kUsedFeatures)) {
    beginOdometry();
    report = odometry_->process(frame);
  }
  if (report.used + (poses_.empty() ? report.initialised : 0) >= kUsedFeatures)
    poses_.push_back(seenPose(moved.stamp, odometry_->state()));
  forgetOld(frame.stamp);
  if (moved.stamp == frame.stamp) tryToStart(); // else the IMU's samples before it may be on their way
  return report;
}

/// All before the oldest pose that counts, but the IMU's sample right before it.
void InertialEstimator::forgetOld(Stamp now) {
  while (!poses_.empty() && secondsBetween(poses_.front().stamp, now) > kLongestStart) poses_.pop_front();
  const Stamp from = poses_.empty() ? now - fromSeconds(kLongestStart) : poses_.front().stamp;
  std::size_t gone = 0;
  for (std::size_t i = 0; i < window_.size() && stampOf(window_[i]) <= from; ++i) {
    if (std::holds_alternative<ImuSample>(window_[i])) gone = i;
  }
  window_.erase(window_.begin(), window_.begin() + static_cast<std::ptrdiff_t>(gone));
}

void InertialEstimator::tryToStart() {
  orderWindow();
  if (poses_.size() < 4 || secondsBetween(poses_.front().stamp, poses_.back().stamp) < kShortestStart) {
    problem_ = "waits for frames with features";
    return;
  }
  if (!std::holds_alternative<ImuSample>(window_.front())) {
    problem_ = "waits for the IMU";
    return;
  }
  problem_ = startFrom({poses_.begin(), poses_.end()});
}

/// By stamp, since a clock that is found moves frames, and from the first sample of the IMU on.
void InertialEstimator::orderWindow() {
  const auto earlier = [](const Measurement& a, const Measurement& b) { return stampOf(a) < stampOf(b); };
  std::stable_sort(window_.begin(), window_.end(), earlier);
  const auto is_imu = [](const Measurement& m) { return std::holds_alternative<ImuSample>(m); };
  const auto first = std::find_if(window_.begin(), window_.end(), is_imu);
  if (first == window_.end()) return;
  const Stamp from = stampOf(*first);
  while (stampOf(window_.front()) < from) window_.pop_front();
  while (!poses_.empty() && poses_.front().stamp < from) poses_.pop_front();
}

/// Empty: it has started. Else why not.
std::string InertialEstimator::startFrom(const std::vector<SeenPose>& poses) {
  std::vector<ImuSample> samples;
  for (const Measurement& m : window_) {
    if (const auto* sample = std::get_if<ImuSample>(&m)) samples.push_back(*sample);
  }
  std::vector<SeenPose> weighed = poses;
  const StateEstimate now = odometry_->state();
  const double density = imu_.over(now.stamp, now.stamp).acceleration_density.trace() / 3.0;
  // What the motion from the first frame to the second one lacks is the noise of both, half of it each one's
  // own. That of the first is common to all later poses, whose drift grows from the second on.
  const Eigen::Array3d second = poses[1].position_sigma.array().square();
  const Eigen::Array3d own = 0.5 * (second - poses[0].position_sigma.array().square()).max(0.0);
  for (SeenPose& pose : weighed) {
    const double t = secondsBetween(poses.front().stamp, pose.stamp);
    const double shaken = density * t * t * t / 3.0; // of the twice integrated accelerations
    const Eigen::Array3d drift = (pose.position_sigma.array().square() - second).max(0.0);
    pose.position_sigma = (kLeastSigma * kLeastSigma + own + drift + shaken).sqrt();
  }
  const Eigen::Vector3d gyro_bias = odometry_->gyroBias();
  const double length = config_.inertial.gravity;
  const auto fit = fitGravity(weighed, samples, gyro_bias, config_.inertial.accelerometer_bias_sigma, length);
  if (!fit) return "the first frames do not tell gravity";
  const double tolerance = kSigmas * fit->free_length_sigma + kGravityTolerance;
  if (std::abs(fit->free_length - length) > tolerance) {
    const std::string problem = "gravity is not explained: the accelerometer and the pictures have " +
                                rounded(fit->free_length) + " m/s^2, it must be " + rounded(length) +
                                " within " + rounded(tolerance);
    return problem + (fit->free_length < 0.5 * length
                          ? " (are the accelerations in g? they must be in m/s^2)"
                          : " (are the IMU's axes those of the transform to the camera?)");
  }
  if (fit->misfit > kLargestMisfit)
    return "the accelerometer contradicts the pictures: " + rounded(fit->misfit) +
           " standard deviations, at most " + rounded(kLargestMisfit) +
           " (are the IMU's axes those of the transform to the camera?)";
  if (fit->tilt_sigma > kKnownTilt)
    return "gravity is known to " + rounded(fit->tilt_sigma) + " rad, " + rounded(kKnownTilt) + " are needed";

  InitialState state;
  state.stamp = stampOf(window_.front());
  const Eigen::Matrix3d up =
      Eigen::Quaterniond::FromTwoVectors(fit->gravity, -Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d R = up * poses.front().frame_T_imu.rotation();
  const Eigen::Matrix3d ahead = so3::Exp({0.0, 0.0, -so3::heading(R)});
  state.world_T_imu = SE3(ahead * R, Eigen::Vector3d::Zero());
  state.velocity = ahead * up * fit->velocity;
  state.gyro_bias = gyro_bias;
  Eigen::Matrix<double, 15, 1> sigma;
  sigma << Eigen::Vector3d::Constant(kAnchored), kStartTilt, kStartTilt, kAnchored,
      Eigen::Vector3d::Constant(kStartVelocity), Eigen::Vector3d::Constant(config_.inertial.gyro_bias_sigma),
      Eigen::Vector3d::Constant(config_.inertial.accelerometer_bias_sigma);
  state.covariance = sigma.cwiseAbs2().asDiagonal();
  auto filter = makeFilter();
  filter->begin(state);
  filter->preset(imu_);
  const bool follows = replay(*filter);
  if (learnClock(*filter)) return "begins anew with the pictures' clock that was found";
  if (!follows)
    return "the accelerometer contradicts the pictures once the filter begins (are the IMU's axes those of "
           "the transform to the camera?)";
  filter->moveOriginHere();
  if (map_) filter->relocaliseIn(map_); // not before: the origin is here until its place in the map is found
  filter_ = std::move(filter);
  odometry_.reset();
  window_.clear();
  poses_.clear();
  return {};
}

/// Whether it goes on from there: a start by a fit that was none, or where it is not linear, does not predict
/// the frames that it is made of.
bool InertialEstimator::replay(InvariantEstimator& filter) const {
  std::size_t used = 0, rejected = 0;
  for (auto m = window_.begin(); m != window_.end(); ++m) {
    const auto is_imu = [](const Measurement& x) { return std::holds_alternative<ImuSample>(x); };
    const auto next = std::find_if(m, window_.end(), is_imu);
    if (next != window_.end()) filter.expect(std::get<ImuSample>(*next));
    if (const auto* frame = std::get_if<StereoFrame>(&*m)) {
      const FrameReport report = filter.process(*frame);
      if (report.divergence != Divergence::kNone) return false;
      used += report.used;
      rejected += report.rejected;
    } else if (const auto* velocity = std::get_if<VelocitySample>(&*m)) {
      filter.process(*velocity);
    } else {
      filter.process(std::get<ImuSample>(*m));
    }
  }
  return static_cast<double>(rejected) <= kLargestRejection * static_cast<double>(used + rejected);
}

/// All frames of the window were looked at with the clock that was told. Where the filter has found another
/// one, beyond what is linear, they are put where they belong, and the start is not yet. The prior counts as
/// if it had said so, of which little is left in what is known by then.
bool InertialEstimator::learnClock(const InvariantEstimator& filter) {
  const auto rig = filter.rig();
  if (!rig || !(rig->time_offset_sigma < kLearnt * config_.rig.time_offset_sigma)) return false;
  if (std::abs(rig->time_offset - config_.rig.time_offset) < kLinearClock) return false;
  const Stamp ahead = fromSeconds(rig->time_offset) - fromSeconds(config_.rig.time_offset);
  config_.rig.time_offset = rig->time_offset;
  for (Measurement& m : window_) {
    if (auto* frame = std::get_if<StereoFrame>(&m)) moveTo(rig->time_offset, *frame);
  }
  for (SeenPose& pose : poses_) pose.stamp += ahead;
  return true;
}

StateEstimate InertialEstimator::state() const { return filter_ ? filter_->state() : odometry_->state(); }

std::vector<LandmarkEstimate> InertialEstimator::landmarks() const {
  return filter_ ? filter_->landmarks() : std::vector<LandmarkEstimate>();
}

std::function<MapEstimate()> InertialEstimator::exactMap() const {
  return filter_ ? filter_->exactMap() : [] { return MapEstimate(); };
}

std::function<SavedMap()> InertialEstimator::savedMap() const {
  return filter_ ? filter_->savedMap() : std::function<SavedMap()>();
}

void InertialEstimator::relocaliseIn(std::shared_ptr<const SavedMap> map) {
  map_ = map;
  if (filter_) filter_->relocaliseIn(std::move(map));
}

void InertialEstimator::resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source,
                                   double max_gap_s) {
  auto filter = makeFilter();
  filter->resumeFrom(map, source, max_gap_s);
  resuming_ = std::move(filter);
  resume_map_ = std::move(map);
}

MapUse InertialEstimator::mapUse() const {
  if (filter_) return filter_->mapUse();
  return map_ || resuming_ ? MapUse::kWaiting : MapUse::kNone;
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/slam/inertial_alignment.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

// s of poses: over less any steady error of the accelerometer passes for gravity and velocity.
constexpr double kShortest = 1.0;
constexpr double kLongest = 1.9; // s; what is older is forgotten
constexpr std::size_t kFewestPoses = 4;
constexpr double kKnownTilt = 0.05; // rad, standard deviation with which the filter may begin
// Of the positions, RMS in standard deviations. An IMU whose axes are others passes for right most easily
// while little has been seen, so that the two must agree then as noise alone has them (99.9 % of fits to 11
// poses), and over two seconds as they do with a calibration that is not perfect.
constexpr double kLargestMisfit = 3.0, kLargestEarlyMisfit = 1.3;
constexpr double kSigmas = 4.0;
// m/s^2: gravity's own range on Earth is 0.05, an accelerometer's scale 1 %
constexpr double kGravityTolerance = 0.2;
constexpr std::size_t kUsedFeatures = 8;   // of a frame whose pose counts
constexpr std::size_t kFewestTracked = 20; // of its own, however few the filter is to have
constexpr double kLongestBlindness = 0.5;  // s; what is seen after it is not known to be near what was before
constexpr double kLeastSigma = 1e-3;       // m, of a pose: what front ends do wrong together
// Wide beside what a start is known to, narrow enough for the filter to be linear there.
constexpr double kStartTilt = 0.2;     // rad
constexpr double kStartVelocity = 1.0; // m/s
constexpr double kAnchored = 1e-6;     // m, rad: the map begins there
// Of the first step, what is wrong with it by being of any length, with points seen once: not linear. A car's
// is 4 % too long.
constexpr double kFirstStep = 0.05;

/// Odometry with a hand's or a drone's accelerations.
InvariantConfig odometryConfig(InvariantConfig config) {
  config.choice = MotionChoice::kConstantTwist;
  config.map.keep = MapKeep::kNone;
  config.max_tracked = std::max(config.max_tracked, kFewestTracked);
  config.slip.sigma = 0.0; // which over so short a way is a scale that nothing else tells
  config.motion.twist_density << 5.0, 5.0, 5.0, 5.0, 5.0, 5.0;
  config.motion.prior_bias_sigma.tail<3>().setConstant(config.inertial.gyro_bias_sigma);
  return config;
}

/// By the clock of the pictures that is known now.
void moveTo(double time_offset, StereoFrame& frame) {
  frame.stamp += fromSeconds(time_offset) - fromSeconds(frame.time_offset);
  frame.time_offset = time_offset;
}

} // namespace

InertialAlignment::InertialAlignment(const InvariantConfig& config)
    : config_(config), imu_(config.inertial.noise, config.inertial.noise_given) {
  begin();
}

/// Anew.
void InertialAlignment::begin() {
  odometry_ = std::make_unique<InvariantEstimator>(odometryConfig(config_));
  origin_.reset();
  poses_.clear();
}

void InertialAlignment::setRig(const StereoRig& rig) {
  config_.told_rig = rig;
  odometry_->setRig(rig);
}

void InertialAlignment::setBiasPrior(const TwistBias& bias) {
  config_.told_bias = bias;
  odometry_->setBiasPrior(bias);
}

void InertialAlignment::setGates(const Gates& gates) {
  config_.setGates(gates);
  odometry_->setGates(gates);
}

void InertialAlignment::process(const ImuSample& sample) {
  imu_.reach(sample);
  measurements_.emplace_back(sample);
  if (origin_) odometry_->process(sample); // it begins with a frame
  forgetOld(sample.stamp);
}

void InertialAlignment::process(const VelocitySample& sample) {
  measurements_.emplace_back(sample);
  if (origin_) odometry_->process(sample);
}

FrameReport InertialAlignment::process(const StereoFrame& frame) {
  StereoFrame moved = frame; // of the clock that was known when it came
  moveTo(config_.rig.time_offset, moved);
  measurements_.emplace_back(moved);
  FrameReport report = odometry_->process(frame);
  const bool is_blind =
      poses_.empty() || secondsBetween(poses_.back().stamp, frame.stamp) > kLongestBlindness;
  if (report.divergence != Divergence::kNone || (is_blind && report.used < kUsedFeatures)) {
    begin();
    report = odometry_->process(frame);
  }
  if (report.used + (origin_ ? 0 : report.initialised) >= kUsedFeatures) {
    const StateEstimate state = odometry_->state();
    poses_.push_back(
        {moved.stamp, state.world_T_imu, state.pose_covariance.diagonal().head<3>().cwiseSqrt()});
    if (!origin_) origin_ = moved.stamp;
    if (poses_.size() == 2 && startsAtOrigin())
      first_step_variance_ = poses_.back().position_sigma.cwiseAbs2();
  }
  forgetOld(frame.stamp);
  return report;
}

void InertialAlignment::setTimeOffset(double time_offset) {
  const Stamp ahead = fromSeconds(time_offset) - fromSeconds(config_.rig.time_offset);
  config_.rig.time_offset = time_offset;
  for (Measurement& m : measurements_) {
    if (auto* frame = std::get_if<StereoFrame>(&m)) moveTo(time_offset, *frame);
  }
  for (SeenPose& pose : poses_) pose.stamp += ahead;
  if (origin_) *origin_ += ahead;
}

/// All before the oldest pose that counts, but the IMU's sample right before it and what follows that.
void InertialAlignment::forgetOld(Stamp now) {
  while (!poses_.empty() && secondsBetween(poses_.front().stamp, now) > kLongest) poses_.pop_front();
  const Stamp from = poses_.empty() ? now - fromSeconds(kLongest) : poses_.front().stamp;
  std::optional<std::size_t> last_imu;
  std::size_t older = 0;
  for (std::size_t i = 0; i < measurements_.size() && stampOf(measurements_[i]) <= from; ++i) {
    if (isImu(measurements_[i])) last_imu = i;
    if (stampOf(measurements_[i]) < from) older = i + 1;
  }
  const std::size_t gone = last_imu.value_or(older);
  measurements_.erase(measurements_.begin(), measurements_.begin() + static_cast<std::ptrdiff_t>(gone));
}

/// By stamp, since a clock that is found moves frames, and from the first sample of the IMU on.
void InertialAlignment::order() {
  const auto earlier = [](const Measurement& a, const Measurement& b) { return stampOf(a) < stampOf(b); };
  std::stable_sort(measurements_.begin(), measurements_.end(), earlier);
  const auto first = std::find_if(measurements_.begin(), measurements_.end(), isImu);
  if (first == measurements_.end()) return;
  const Stamp from = stampOf(*first);
  while (stampOf(measurements_.front()) < from) measurements_.pop_front();
  while (!poses_.empty() && poses_.front().stamp < from) poses_.pop_front();
}

/// No later pose would be as long after the oldest one.
bool InertialAlignment::isFull() const {
  if (poses_.size() < kFewestPoses) return false;
  const double span = secondsBetween(poses_.front().stamp, poses_.back().stamp);
  return span + span / static_cast<double>(poses_.size() - 1) > kLongest;
}

InertialAlignment::Result InertialAlignment::align() {
  order();
  if (poses_.size() < kFewestPoses || secondsBetween(poses_.front().stamp, poses_.back().stamp) < kShortest)
    return {{},
            "waits for frames with features: " + std::to_string(kUsedFeatures) +
                " that are followed in each, over " + rounded(kShortest) + " s"};
  if (!isImu(measurements_.front())) return {{}, "waits for the IMU"};
  std::vector<ImuSample> samples;
  for (const Measurement& m : measurements_) {
    if (const auto* sample = std::get_if<ImuSample>(&m)) samples.push_back(*sample);
  }
  const auto fit = fitGravity(weighedPoses(), samples, odometry_->gyroBias(),
                              config_.inertial.accelerometer_bias_sigma, config_.inertial.gravity);
  if (!fit) return {{}, "the first frames do not tell gravity"};
  if (const std::string problem = contradictionOf(*fit); !problem.empty()) return {{}, problem, true};
  if (fit->tilt_sigma > kKnownTilt)
    return {
        {},
        "gravity is known to " + rounded(fit->tilt_sigma) + " rad, " + rounded(kKnownTilt) + " are needed"};
  // A clock that may be off shows in the misfit, and is found by the filter.
  if (!isFull() && fit->misfit > kLargestEarlyMisfit && !(config_.rig.time_offset_sigma > 0.0))
    return {{},
            "waits for " + rounded(kLongest) + " s of frames: the accelerometer and the pictures differ by " +
                rounded(fit->misfit) + " standard deviations, " + rounded(kLargestEarlyMisfit) +
                " would do already"};
  const Eigen::Matrix3d& now = poses_.back().frame_T_imu.rotation();
  return {stateOf(*fit), {}, false, now.transpose() * -fit->gravity.normalized()};
}

/// Each with its frame's own noise, its drift since the first step, and what the accelerations until then are
/// known to. What the first step lacks is the noise of two frames, half of it each one's own.
std::vector<SeenPose> InertialAlignment::weighedPoses() const {
  const StateEstimate now = odometry_->state();
  const double density = imu_.over(now.stamp, now.stamp).acceleration_density.trace() / 3.0;
  const Eigen::Array3d own = 0.5 * first_step_variance_.array();
  Eigen::Array3d begun = first_step_variance_.array();
  if (!startsAtOrigin()) begun = poses_.front().position_sigma.array().square();
  std::vector<SeenPose> weighed(poses_.begin(), poses_.end());
  for (SeenPose& pose : weighed) {
    const double t = secondsBetween(poses_.front().stamp, pose.stamp);
    const double shaken = density * t * t * t / 3.0; // of the twice integrated accelerations
    const Eigen::Array3d drift = (pose.position_sigma.array().square() - begun).max(0.0);
    pose.position_sigma = (kLeastSigma * kLeastSigma + own + drift + shaken).sqrt();
  }
  if (startsAtOrigin()) {
    const Eigen::Vector3d step = poses_[1].frame_T_imu.translation() - poses_[0].frame_T_imu.translation();
    weighed[0].position_sigma.array() += kFirstStep * step.norm();
  }
  return weighed;
}

std::string InertialAlignment::contradictionOf(const GravityFit& fit) const {
  const double length = config_.inertial.gravity;
  const double tolerance = kSigmas * fit.free_length_sigma + kGravityTolerance;
  if (std::abs(fit.free_length - length) > tolerance)
    return "gravity is not explained: the accelerometer and the pictures have " + rounded(fit.free_length) +
           " m/s^2, it must be " + rounded(length) + " within " + rounded(tolerance) + " (" +
           (fit.free_length < 0.5 * length ? "are the accelerations in g, or is gravity taken out of them? "
                                           : "") +
           kAxes;
  if (fit.misfit > kLargestMisfit)
    return "the accelerometer contradicts the pictures: " + rounded(fit.misfit) +
           " standard deviations, at most " + rounded(kLargestMisfit) + " (" + kAxes;
  return {};
}

InitialState InertialAlignment::stateOf(const GravityFit& fit) const {
  InitialState state;
  state.stamp = stampOf(measurements_.front());
  const Eigen::Matrix3d up =
      Eigen::Quaterniond::FromTwoVectors(fit.gravity, -Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Matrix3d R = up * poses_.front().frame_T_imu.rotation();
  const Eigen::Matrix3d ahead = so3::Exp({0.0, 0.0, -so3::heading(R)});
  state.world_T_imu = SE3(ahead * R, Eigen::Vector3d::Zero());
  state.velocity = ahead * up * fit.velocity;
  state.gyro_bias = odometry_->gyroBias();
  Eigen::Matrix<double, 15, 1> sigma;
  sigma << Eigen::Vector3d::Constant(kAnchored), kStartTilt, kStartTilt, kAnchored,
      Eigen::Vector3d::Constant(kStartVelocity), Eigen::Vector3d::Constant(config_.inertial.gyro_bias_sigma),
      Eigen::Vector3d::Constant(config_.inertial.accelerometer_bias_sigma);
  state.covariance = sigma.cwiseAbs2().asDiagonal();
  return state;
}

} // namespace vi_ekf_slam

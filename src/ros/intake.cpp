#include "vi_ekf_slam/ros/intake.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "vi_ekf_slam/ros/input/feature_screen.hpp"

namespace vi_ekf_slam {

using conversions::Rejection;

namespace {

constexpr std::size_t kMostReported = 20; // what writes another name each time is not to fill the memory

constexpr std::size_t index(Stream stream) { return static_cast<std::size_t>(stream); }

bool isUnsaid(const Eigen::Matrix3d& covariance, Eigen::Index axis) {
  return covariance.row(axis).isZero(0.0) && covariance.col(axis).isZero(0.0);
}

/// Wheel odometry often gives a variance for the way ahead alone, and zeros for the other axes; a gyro of one
/// axis does too.
void fillUnsaidAxes(Eigen::Matrix3d& covariance, double sigma) {
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (isUnsaid(covariance, i)) covariance(i, i) = sigma * sigma;
  }
}

} // namespace

Intake::Intake(SlamSystem& system, const RosConfig& config, const InputTopics& topics)
    : system_(system),
      topics_(topics),
      imu_frame_(config.imu_frame),
      rig_(frames_, topics.left_info, topics.right_info),
      velocities_(frames_, config),
      max_features_(config.max_features),
      feature_limit_(config.max_features) {
  rig_.setImuFrame(imu_frame_);
  velocities_.setImuFrame(imu_frame_);
}

std::uint64_t Intake::received() const {
  return std::accumulate(counts_.received.begin(), counts_.received.end(), std::uint64_t{0});
}

std::string Intake::topicsOf(Stream stream) const {
  if (stream == Stream::kImu) return topics_.imu;
  if (stream == Stream::kStereo) return topics_.features;
  const bool both = !topics_.velocity.empty() && !topics_.wheel_odometry.empty();
  return topics_.velocity + (both ? " or " : "") + topics_.wheel_odometry;
}

/// An IMU with accelerometers does without a velocity, and a camera without either; a gyro and a camera do
/// where no velocity is to be listened to.
bool Intake::isRequired(Stream stream) const {
  if (topicsOf(stream).empty()) return false;
  if (stream == Stream::kStereo) return system_.needsRig();
  const bool is_twist = system_.motion() != MotionChoice::kInertial;
  return !isCameraAlone() && (is_twist || stream == Stream::kImu);
}

/// By what has come up to now.
bool Intake::isCameraAlone() const {
  const auto came = [this](Stream s) { return counts_.received[index(s)] > 0; };
  return system_.motion() != MotionChoice::kInertial && came(Stream::kStereo) && !came(Stream::kImu) &&
         !came(Stream::kVelocity);
}

template <typename Condition>
std::string Intake::requiredInputs(const Condition& condition) const {
  std::string topics;
  for (const Stream stream : {Stream::kImu, Stream::kVelocity, Stream::kStereo}) {
    if (isRequired(stream) && condition(index(stream)))
      topics += (topics.empty() ? "" : ", ") + topicsOf(stream);
  }
  return topics;
}

std::string Intake::missingInputs() const {
  return requiredInputs([this](std::size_t i) { return counts_.received[i] == 0; });
}

std::string Intake::unusedInputs() const {
  const SystemCounts counts = system_.counts();
  return requiredInputs([&](std::size_t i) { return counts_.received[i] > 0 && counts.processed[i] == 0; });
}

void Intake::learnImuFrame(const std::string& frame_id) {
  if (!imu_frame_.empty()) return;
  imu_frame_ = conversions::frameName(frame_id);
  rig_.setImuFrame(imu_frame_);
  velocities_.setImuFrame(imu_frame_);
  release(false); // what came before this message
  offerRig();
}

void Intake::takeCameraForBody() {
  if (!imu_frame_.empty() || rig_.leftFrame().empty() || !system_.needsRig() || !isCameraAlone()) return;
  report("imu: none", "no message on " + topics_.imu + ": what moves is the left camera, '" +
                          rig_.leftFrame() + "'; ros/imu_frame may name another frame");
  camera_is_body_ = true;
  learnImuFrame(rig_.leftFrame());
}

/// In place of the camera, since an IMU's driver may start late; no, as long as nothing connects the two.
bool Intake::takeImuForBody(const std::string& imu_frame) {
  rig_.setImuFrame(imu_frame);
  if (!rig_.rig()) {
    report("imu: " + imu_frame, "imu messages in '" + imu_frame + "' are not used: " + rig_.problem());
    rig_.setImuFrame(imu_frame_);
    return false;
  }
  system_.flush(); // what came before is of the camera
  system_.setRig(*rig_.rig());
  system_.reset("an IMU has come, and takes the left camera's place as what moves");
  imu_frame_ = imu_frame;
  velocities_.setImuFrame(imu_frame_);
  camera_is_body_ = false;
  return true;
}

void Intake::report(const std::string& frame, const std::string& problem) {
  if (reported_.size() < kMostReported && reported_.insert(frame).second && handler_) handler_(problem);
}

void Intake::turnAway(const char* input, Rejection rejection) {
  ++counts_.turned_away[std::string(input) + ": " + conversions::describe(rejection)];
}

void Intake::turnAway(const char* reason, std::size_t count) {
  if (count > 0) counts_.turned_away[reason] += count;
}

std::map<std::string, std::uint64_t> Intake::turnedAway() const {
  auto all = counts_.turned_away;
  const SystemCounts counts = system_.counts();
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    const std::string input = kTopicNames[i];
    if (counts.too_fast[i] > 0) all[input + ": too fast"] = counts.too_fast[i];
    if (counts.bad_covariance[i] > 0)
      all[input + ": covariance not positive definite"] = counts.bad_covariance[i];
  }
  return all;
}

void Intake::offerRig() {
  if (!system_.hasRig() && rig_.rig()) system_.setRig(*rig_.rig());
}

void Intake::hand(Arrival arrival) {
  waiting_.push_back(std::move(arrival));
  release(false);
}

/// Sensor time has passed; a stamp that is far off ends the waiting too, which must not last for ever.
bool Intake::hasWaited(const Arrival& arrival) const {
  const double waited = secondsBetween(stampOf(arrival.measurement), stampOf(waiting_.back().measurement));
  return std::abs(waited) >= system_.config().rig_wait_s ||
         waiting_.size() > system_.config().buffer.max_size;
}

void Intake::release(bool at_once) {
  while (!waiting_.empty()) {
    Arrival& first = waiting_.front();
    auto* velocity = std::get_if<VelocitySample>(&first.measurement);
    const bool usable = velocity == nullptr || velocities_.carry(*velocity, first.frame);
    if (velocity != nullptr && usable) may_wait_ = false;
    if (!usable) {
      const bool is_hopeless = velocities_.isImpossible(first.frame);
      if (may_wait_ && !at_once && !is_hopeless && !hasWaited(first)) return;
      may_wait_ = may_wait_ && is_hopeless;
      report("velocity: " + first.frame, velocities_.problem(first.frame));
      turnAway("velocity: no transform from its frame to the IMU's", 1);
    }
    Arrival arrival = std::move(waiting_.front());
    waiting_.pop_front();
    if (usable) system_.add(std::move(arrival.measurement));
  }
}

void Intake::flush() {
  takeCameraForBody();
  release(true);
}

void Intake::add(const sensor_msgs::Imu& message) {
  ++counts_.received[index(Stream::kImu)];
  auto converted = conversions::toImu(message, camera_is_body_ ? std::string() : imu_frame_);
  if (!converted.sample) {
    if (converted.rejection == Rejection::kWrongFrame)
      report("imu: " + message.header.frame_id,
             "imu messages in '" + message.header.frame_id + "' are not used: " +
                 (imu_frame_.empty() ? std::string("header.frame_id must say the IMU's frame")
                                     : "the IMU's frame is '" + imu_frame_ +
                                           "', which ros/imu_frame or the first imu message said"));
    return turnAway("imu", converted.rejection);
  }
  if (converted.sample->covariance)
    fillUnsaidAxes(*converted.sample->covariance, system_.config().invariant.motion.gyro_sigma);
  auto& of_acceleration = converted.sample->acceleration_covariance; // configured as a density, not a sigma
  if (of_acceleration &&
      (isUnsaid(*of_acceleration, 0) || isUnsaid(*of_acceleration, 1) || isUnsaid(*of_acceleration, 2)))
    of_acceleration.reset();
  if (camera_is_body_ && !takeImuForBody(conversions::frameName(message.header.frame_id)))
    return turnAway("imu", Rejection::kWrongFrame);
  learnImuFrame(message.header.frame_id); // of the first one that can be used
  hand({std::move(*converted.sample), {}});
}

void Intake::add(const geometry_msgs::TwistWithCovarianceStamped& message) {
  addVelocity(conversions::toVelocity(message), message.header.frame_id);
}

void Intake::add(const nav_msgs::Odometry& message) {
  addVelocity(conversions::toVelocity(message), message.child_frame_id);
}

void Intake::addVelocity(conversions::Converted<VelocitySample> converted, const std::string& frame_id) {
  ++counts_.received[index(Stream::kVelocity)];
  if (!converted.sample) return turnAway("velocity", converted.rejection);
  if (converted.sample->covariance)
    fillUnsaidAxes(*converted.sample->covariance, system_.config().invariant.motion.velocity_sigma);
  hand({std::move(*converted.sample), conversions::frameName(frame_id)});
}

void Intake::addTwistBias(const geometry_msgs::TwistWithCovarianceStamped& message) {
  const auto converted = conversions::toTwistBias(message, imu_frame_);
  if (!converted.sample) return turnAway("twist_bias", converted.rejection);
  system_.setBiasPrior(*converted.sample);
}

void Intake::add(const StereoFeatureArray& message) {
  ++counts_.received[index(Stream::kStereo)];
  // Where no IMU is wanted what moves is the left camera.
  if (imu_frame_.empty() && topics_.imu.empty()) learnImuFrame(message.header.frame_id);
  auto converted = conversions::toFrame(message, rig_.leftFrame());
  if (!converted.sample) {
    if (converted.rejection == Rejection::kWrongFrame)
      report("features: " + message.header.frame_id,
             "features in '" + message.header.frame_id + "' are not used: " +
                 (rig_.leftFrame().empty() ? std::string("header.frame_id must say the left camera's frame")
                                           : topics_.left_info + " is of '" + rig_.leftFrame() + "'"));
    return turnAway("features", converted.rejection);
  }
  turnAway("features: repeated id", converted.repeated_ids);
  const std::string problem =
      stereo_check_.note(*converted.sample, system_.config().invariant.stereo.pixel_sigma);
  if (!problem.empty()) report("features", problem);
  const ScreenCounts screened = screenFeatures(*converted.sample, rig_.imageSize(), max_features_);
  turnAway("features: pixel not finite", screened.not_finite);
  turnAway("features: pixel outside the image", screened.outside);
  turnAway("features: absurd pixel or disparity", screened.absurd);
  turnAway("features: more than max_features in a message", screened.surplus);
  counts_.without_disparity += screened.no_disparity;
  if (feature_limit_ < max_features_) {
    counts_.shed_features += screenFeatures(*converted.sample, {}, feature_limit_).surplus;
  }
  if (!first_frame_) first_frame_ = converted.sample->stamp;
  if (std::abs(secondsBetween(*first_frame_, converted.sample->stamp)) >= system_.config().rig_wait_s)
    takeCameraForBody();
  hand({std::move(*converted.sample), {}});
}

void Intake::addLeftInfo(const sensor_msgs::CameraInfo& message) {
  rig_.addLeft(message);
  offerRig();
}

void Intake::addRightInfo(const sensor_msgs::CameraInfo& message) {
  rig_.addRight(message);
  offerRig();
}

void Intake::addTransforms(const tf2_msgs::TFMessage& message, bool is_static) {
  frames_.add(message, is_static);
  rig_.noteTransforms();
  offerRig();
  release(false);
}

} // namespace vi_ekf_slam

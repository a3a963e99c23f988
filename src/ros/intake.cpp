#include "vi_ekf_slam/ros/intake.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "vi_ekf_slam/ros/feature_screen.hpp"

namespace vi_ekf_slam {

using conversions::Rejection;

namespace {

constexpr std::size_t index(Stream stream) { return static_cast<std::size_t>(stream); }

} // namespace

Intake::Intake(SlamSystem& system, const RosConfig& config, const InputTopics& topics)
    : system_(system),
      topics_(topics),
      imu_frame_(config.imu_frame),
      rig_(topics.left_info, topics.right_info),
      max_features_(config.max_features),
      feature_limit_(config.max_features) {
  rig_.setImuFrame(imu_frame_);
}

std::uint64_t Intake::received() const {
  return std::accumulate(received_.begin(), received_.end(), std::uint64_t{0});
}

std::string Intake::missingInputs() const {
  std::string missing;
  const auto require = [&](Stream stream, const std::string& topic) {
    if (received_[index(stream)] == 0) missing += (missing.empty() ? "" : ", ") + topic;
  };
  require(Stream::kGyro, topics_.imu);
  require(Stream::kVelocity, topics_.velocity);
  if (system_.needsRig()) require(Stream::kStereo, topics_.features);
  return missing;
}

void Intake::learnImuFrame(const std::string& frame_id) {
  if (!imu_frame_.empty()) return;
  imu_frame_ = conversions::frameName(frame_id);
  rig_.setImuFrame(imu_frame_);
  offerRig();
}

void Intake::turnAway(const char* input, Rejection rejection) {
  ++turned_away_[std::string(input) + ": " + conversions::describe(rejection)];
}

void Intake::turnAway(const char* reason, std::size_t count) {
  if (count > 0) turned_away_[reason] += count;
}

void Intake::offerRig() {
  if (!system_.hasRig() && rig_.rig()) system_.setRig(*rig_.rig());
}

void Intake::add(const sensor_msgs::Imu& message) {
  ++received_[index(Stream::kGyro)];
  auto converted = conversions::toGyro(message, imu_frame_);
  if (!converted.sample) return turnAway("imu", converted.rejection);
  learnImuFrame(message.header.frame_id); // of the first one that can be used
  system_.add(std::move(*converted.sample));
}

void Intake::add(const geometry_msgs::TwistWithCovarianceStamped& message) {
  ++received_[index(Stream::kVelocity)];
  auto converted = conversions::toVelocity(message, imu_frame_);
  if (!converted.sample) return turnAway("velocity", converted.rejection);
  learnImuFrame(message.header.frame_id);
  system_.add(std::move(*converted.sample));
}

void Intake::addTwistBias(const geometry_msgs::TwistWithCovarianceStamped& message) {
  const auto converted = conversions::toTwistBias(message, imu_frame_);
  if (!converted.sample) return turnAway("twist_bias", converted.rejection);
  system_.setBiasPrior(*converted.sample);
}

void Intake::add(const StereoFeatureArray& message) {
  ++received_[index(Stream::kStereo)];
  auto converted = conversions::toFrame(message, rig_.leftFrame());
  if (!converted.sample) return turnAway("features", converted.rejection);
  turnAway("features: repeated id", converted.repeated_ids);
  const ScreenCounts screened = screenFeatures(*converted.sample, rig_.imageSize(), max_features_);
  turnAway("features: pixel not finite", screened.not_finite);
  turnAway("features: pixel outside the image", screened.outside);
  turnAway("features: absurd pixel or disparity", screened.absurd);
  turnAway("features: more than max_features in a message", screened.surplus);
  without_disparity_ += screened.no_disparity;
  if (feature_limit_ < max_features_) {
    shed_features_ += screenFeatures(*converted.sample, {}, feature_limit_).surplus;
  }
  system_.add(std::move(*converted.sample));
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
  rig_.addTransforms(message, is_static);
  offerRig();
}

} // namespace vi_ekf_slam

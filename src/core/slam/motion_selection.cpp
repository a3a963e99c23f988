#include "vi_ekf_slam/core/slam/motion_selection.hpp"

#include <optional>

namespace vi_ekf_slam {
namespace {

constexpr int kWithoutAcceleration = 3; // samples: the first of some drivers is empty
constexpr const char* kNoAcceleration =
    "the IMU's messages carry no acceleration (all are 0, or said not to be measured)";

std::string textOf(MotionChoice choice, const std::string& reason) {
  return (choice == MotionChoice::kInertial ? "inertial, " : "constant twist, ") + reason;
}

} // namespace

MotionSelection::MotionSelection(const Config& config) : choice_(config.invariant.choice) {
  if (config.estimator == EstimatorType::kPaper) {
    choice_ = MotionChoice::kConstantTwist;
  } else if (!isOpen()) {
    text_ = textOf(choice_, "configured");
  }
}

void MotionSelection::note(const ImuSample& sample) {
  if (!isOpen() && !lacks_imu_) return;
  if (!sample.acceleration) {
    if (++without_acceleration_ < kWithoutAcceleration) return;
    lacks_imu_ = false;
    return decide(MotionChoice::kConstantTwist, kNoAcceleration);
  }
  const std::optional<bool> is_fast = imu_rate_.suffices(sample.stamp);
  if (!is_fast) return;
  lacks_imu_ = false;
  *is_fast ? become(MotionChoice::kInertial, "the IMU's messages carry accelerations") : close();
}

void MotionSelection::close() {
  if (!isOpen()) return;
  lacks_imu_ = !imu_rate_.hasSamples() && without_acceleration_ == 0;
  decide(MotionChoice::kConstantTwist,
         imu_rate_.hasSamples() ? "the IMU's messages come at less than 50 Hz, too seldom for their "
                                  "accelerations to be integrated (motion: inertial does it none the less)"
         : lacks_imu_           ? "there is no IMU"
                                : kNoAcceleration);
}

void MotionSelection::decide(MotionChoice choice, const std::string& reason) {
  if (isOpen()) become(choice, reason);
}

void MotionSelection::become(MotionChoice choice, const std::string& reason) {
  choice_ = choice;
  text_ = textOf(choice, reason);
  if (on_decision_) on_decision_();
}

} // namespace vi_ekf_slam

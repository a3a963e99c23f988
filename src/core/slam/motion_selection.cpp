#include "vi_ekf_slam/core/slam/motion_selection.hpp"

#include <optional>

namespace vi_ekf_slam {

MotionSelection::MotionSelection(const Config& config) : choice_(config.invariant.choice) {
  if (config.estimator == EstimatorType::kPaper) {
    choice_ = MotionChoice::kConstantTwist;
  } else if (!isOpen()) {
    decide(choice_, "configured");
  }
}

void MotionSelection::note(const ImuSample& sample) {
  if (!sample.acceleration)
    return decide(MotionChoice::kConstantTwist,
                  "the IMU's messages carry no acceleration (all are 0, or said not to be measured)");
  if (const std::optional<bool> is_fast = imu_rate_.suffices(sample.stamp))
    *is_fast ? decide(MotionChoice::kInertial, "the IMU's messages carry accelerations") : close();
}

void MotionSelection::close() {
  decide(MotionChoice::kConstantTwist,
         imu_rate_.hasSamples() ? "the IMU's messages come at less than 50 Hz, too seldom for their "
                                  "accelerations to be integrated (motion: inertial does it none the less)"
                                : "there is no IMU");
}

void MotionSelection::decide(MotionChoice choice, const std::string& reason) {
  choice_ = choice;
  text_ = (isInertial() ? "inertial, " : "constant twist, ") + reason;
}

} // namespace vi_ekf_slam

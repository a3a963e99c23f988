#include "vi_ekf_slam/core/slam/sensor_checks.hpp"

#include <utility>

namespace vi_ekf_slam {

SensorChecks::SensorChecks(const Config& config)
    : compares_motion_(config.estimator != EstimatorType::kPaper), // the baseline takes all as it is
      noise_(config),
      imu_(config.invariant.inertial.gravity),
      motion_(config.invariant) {}

void SensorChecks::onProblem(std::function<void(const std::string&)> handler) {
  imu_.onProblem(handler);
  on_problem_ = std::move(handler);
}

void SensorChecks::setInertial(bool is_inertial) {
  is_inertial_ = is_inertial;
  noise_.setInertial(is_inertial);
}

void SensorChecks::arrived(Stream stream, Stamp stamp) {
  if (stream == Stream::kImu) imu_.arrived(stamp);
}

void SensorChecks::use(const Measurement& measurement) {
  for (const StreamNoise& news : noise_.note(measurement)) {
    if (on_noise_) on_noise_(news);
  }
}

void SensorChecks::note(const ImuSample& sample) {
  imu_.note(sample, is_inertial_);
  motion_.note(sample);
}

void SensorChecks::note(const StereoFrame& frame) {
  imu_.noteFrame(frame.stamp);
  if (compares_motion_) tell(motion_.note(frame));
}

void SensorChecks::tell(const std::string& problem) {
  if (!problem.empty() && on_problem_) on_problem_(problem);
}

void SensorChecks::restart() {
  imu_.restart();
  motion_.restart();
}

} // namespace vi_ekf_slam

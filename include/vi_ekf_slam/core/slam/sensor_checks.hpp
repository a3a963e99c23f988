#pragma once

#include <functional>
#include <string>

#include "vi_ekf_slam/core/sensors/imu_check.hpp"
#include "vi_ekf_slam/core/slam/motion_check.hpp"
#include "vi_ekf_slam/core/slam/noise_report.hpp"

namespace vi_ekf_slam {

/// What is looked at beside the estimate: which noise the sensors are taken to have, whether the IMU's
/// samples are what they must be, and whether gyro and velocity move as the pictures do. Nothing is dropped
/// for it.
class SensorChecks {
 public:
  explicit SensorChecks(const Config& config);

  /// Called when a sensor is used for the first time: which noise it is taken to have, and from where.
  void onNoise(std::function<void(const StreamNoise&)> handler) { on_noise_ = std::move(handler); }
  /// Called with what is wrong with the sensors, once each.
  void onProblem(std::function<void(const std::string&)> handler);

  void setRig(const StereoRig& rig) { motion_.setRig(rig); }
  /// Whether the motion model is the inertial one; before the first measurement is used.
  void setInertial(bool is_inertial);

  /// A measurement has come; not yet sorted.
  void arrived(Stream stream, Stamp stamp);
  // In the order of stamps:
  void use(const Measurement& measurement);
  void note(const ImuSample& sample);
  /// Of the IMU's own velocity.
  void note(const VelocitySample& sample) { motion_.note(sample); }
  void note(const StereoFrame& frame);
  void note(const FrameReport& report) { tell(motion_.note(report)); }
  /// Time, or the estimate, begins anew.
  void restart();

  const NoiseReport& noise() const { return noise_; }
  const ImuCheck& imu() const { return imu_; }
  const MotionCheck& motion() const { return motion_; }

 private:
  void tell(const std::string& problem);

  bool compares_motion_;
  bool is_inertial_ = false;
  NoiseReport noise_;
  ImuCheck imu_;
  MotionCheck motion_;
  std::function<void(const StreamNoise&)> on_noise_;
  std::function<void(const std::string&)> on_problem_;
};

} // namespace vi_ekf_slam

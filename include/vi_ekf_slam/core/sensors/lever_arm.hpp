#pragma once

#include <optional>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Carries velocities of points beside the IMU's origin there, by the gyro's rate of that moment.
class LeverArm {
 public:
  /// Standard deviations (m/s, rad/s) of samples without a covariance of their own.
  LeverArm(double velocity_sigma, double gyro_sigma)
      : velocity_sigma_(velocity_sigma), gyro_sigma_(gyro_sigma) {}

  /// In the order of stamps.
  void note(const ImuSample& sample) { gyro_ = sample; }
  void restart() { gyro_.reset(); }

  /// v_imu = v_point - omega x lever_arm. Where the rate is not known (no gyro sample in the half second
  /// before) it is taken as 0, and as uncertain. A sample of the IMU's origin is returned as it is.
  VelocitySample atImu(const VelocitySample& sample) const;

 private:
  double velocity_sigma_;
  double gyro_sigma_;
  std::optional<ImuSample> gyro_;
};

} // namespace vi_ekf_slam

#pragma once

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/motion.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// Gyro and accelerometer: the exact angular rate and specific force at the sample's stamp, plus biases that
/// are random walks, plus white noise; the accelerometer's axes with wrong scales and alignment.
class InertialSensor {
 public:
  /// `gyro_bias`: of the first sample, rad/s.
  InertialSensor(const DriveOptions& options, const Eigen::Vector3d& gyro_bias);

  ImuSample measure(Stamp stamp, const Kinematics& body);

  /// Of the last sample, or of the first before there is one.
  const Eigen::Vector3d& gyroBias() const { return gyro_bias_; }                   ///< rad/s
  const Eigen::Vector3d& accelerometerBias() const { return accelerometer_bias_; } ///< m/s^2

 private:
  double gyro_walk_, accelerometer_walk_;   ///< standard deviations of a step of the biases
  double gyro_sigma_, accelerometer_sigma_; ///< of a sample's white noise
  Random noise_random_, walk_random_;
  Eigen::Vector3d gyro_bias_, accelerometer_bias_;
  Eigen::Matrix3d accelerometer_scale_; ///< what is shown of a force
  bool first_ = true;
};

} // namespace vi_ekf_slam::simulation

#pragma once

namespace vi_ekf_slam {

/// What calibrations state of an IMU, as root spectral densities per axis. The defaults are an ordinary MEMS
/// IMU's (ADIS16448 and the like).
struct ImuNoise {
  double gyro_density = 2e-4;          ///< rad/s/sqrt(Hz), white noise of the gyro
  double accelerometer_density = 2e-3; ///< m/s^2/sqrt(Hz), white noise of the accelerometer
  double gyro_walk = 2e-5;             ///< rad/s^2/sqrt(Hz), random walk of its bias
  double accelerometer_walk = 3e-3;    ///< m/s^3/sqrt(Hz), random walk of its bias
};

} // namespace vi_ekf_slam

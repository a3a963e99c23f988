#pragma once

#include <string>

#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/core/sensors/imu_noise.hpp"

namespace vi_ekf_slam {

/// From a file as Kalibr's imu.yaml (accelerometer_noise_density and so on, at the top or below imu0) or
/// EuRoC's sensor.yaml is. Throws ConfigError that names file, key, value and what is allowed.
ImuNoise readImuCalibration(const std::string& path);

/// From a YAML file: stamp (s), position (m), orientation (x, y, z, w), velocity (m/s), gyro_bias (rad/s),
/// accelerometer_bias (m/s^2), covariance (225 numbers, row by row), all as in InitialState. Throws
/// ConfigError as above.
InitialState readInitialState(const std::string& path);

} // namespace vi_ekf_slam

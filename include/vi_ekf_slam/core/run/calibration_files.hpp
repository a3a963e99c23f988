#pragma once

#include <string>

#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/core/observation/rig_variables.hpp"
#include "vi_ekf_slam/core/sensors/imu_track.hpp"

namespace vi_ekf_slam {

// What is known beforehand of IMU, rig and state, as YAML files. What cannot be used is a ConfigError that
// names file, key, value and what is allowed.

/// From a file as Kalibr's imu.yaml (accelerometer_noise_density and so on, at the top or below imu0) or
/// EuRoC's sensor.yaml is.
ImuNoise readImuCalibration(const std::string& path);

/// stamp (s), position (m), orientation (x, y, z, w), velocity (m/s), gyro_bias (rad/s), accelerometer_bias
/// (m/s^2), covariance (225 numbers, row by row), all as in InitialState.
InitialState readInitialState(const std::string& path);

/// A rig's calibration as a run estimated it, for `calibration/file` of the next one's configuration.
std::string rigCalibrationText(const RigEstimate& estimate);
/// Reads such a file; of the camera it has the baseline alone.
RigEstimate readRigCalibration(const std::string& path);

} // namespace vi_ekf_slam

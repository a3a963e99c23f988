#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Where an inertial estimator begins: in a map whose z axis points up.
struct InitialState {
  Stamp stamp = 0;
  SE3 world_T_imu;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();           ///< m/s, world axes
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();          ///< rad/s, IMU frame
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero(); ///< m/s^2, IMU frame
  /// 15x15 of the errors of (position, rotation, velocity, gyro bias, accelerometer bias): the rotation's is
  /// that of R = Exp(error) R_estimated, along the world's axes; the others are truth minus estimate.
  Eigen::Matrix<double, 15, 15> covariance = Eigen::Matrix<double, 15, 15>::Zero();
};

/// Of a field that no vehicle's state has.
struct BadField {
  std::string name, value, allowed;
};
/// The first one of `state`; nothing: all are possible. The orientation is one by its type.
std::optional<BadField> badFieldOf(const InitialState& state);

} // namespace vi_ekf_slam

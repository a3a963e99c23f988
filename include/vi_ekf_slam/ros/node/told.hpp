#pragma once

#include <geometry_msgs/PoseWithCovarianceStamped.h>

#include <string>

#include "vi_ekf_slam/SetState.h"
#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/ros/output/base_frame.hpp"

/// What somebody says of where the vehicle is, in the map, as what it means in the estimator's world. What is
/// returned is what is wrong with it, and what is allowed; empty: nothing, and the last argument is set.
namespace vi_ekf_slam {

/// Where the IMU is in the estimator's world; covariance as in StateEstimate.
struct ToldPose {
  SE3 world_T_imu;
  Matrix6d covariance = Matrix6d::Zero();
};

/// Reads a pose of the base in `map_frame`; by `motion` (then_T_now) it has moved since. Variances of 0, such
/// as rviz sends for what a mouse cannot say, are taken for (0.1 m)^2 and (0.1 rad)^2, a covariance of zeros
/// for (0.5 m)^2 and (0.26 rad)^2.
std::string readToldPose(const geometry_msgs::PoseWithCovarianceStamped& message,
                         const std::string& map_frame, const BaseFrame& base, const SE3& motion,
                         ToldPose& told);

/// Reads a state of the IMU in `map_frame`, `base` of a world whose z axis points up.
std::string readToldState(const SetState::Request& request, const std::string& map_frame,
                          const BaseFrame& base, InitialState& state);

} // namespace vi_ekf_slam

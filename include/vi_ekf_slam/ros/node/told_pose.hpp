#pragma once

#include <geometry_msgs/PoseWithCovarianceStamped.h>

#include <string>

#include "vi_ekf_slam/ros/output/base_frame.hpp"

namespace vi_ekf_slam {

/// Where somebody says the IMU is in the estimator's world; covariance as in StateEstimate.
struct ToldPose {
  SE3 world_T_imu;
  Matrix6d covariance = Matrix6d::Zero();
};

/// Reads a pose of the base in `map_frame`; by `motion` (then_T_now) it has moved since. Variances of 0, such
/// as rviz sends for what a mouse cannot say, are taken for (0.1 m)^2 and (0.1 rad)^2, a covariance of zeros
/// for (0.5 m)^2 and (0.26 rad)^2. What is wrong with the message, and what is allowed; empty: nothing, and
/// `told` is set.
std::string readToldPose(const geometry_msgs::PoseWithCovarianceStamped& message,
                         const std::string& map_frame, const BaseFrame& base, const SE3& motion,
                         ToldPose& told);

} // namespace vi_ekf_slam

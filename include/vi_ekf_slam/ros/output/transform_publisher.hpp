#pragma once

#include <tf2_ros/transform_broadcaster.h>

#include <optional>
#include <string>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Sends map -> odom -> imu (REP 105), or map -> imu where configured. A stamp that is not newer than the
/// last one is not sent, unless time was set back by more than `max_jump_back_s`, which is a new start.
class TransformPublisher {
 public:
  TransformPublisher(const RosConfig& config, double max_jump_back_s);

  /// Whether the transforms were sent.
  bool publish(const Output& output, const std::string& imu_frame);

 private:
  RosConfig config_;
  double max_jump_back_s_;
  std::optional<Stamp> last_;
  tf2_ros::TransformBroadcaster broadcaster_;
};

} // namespace vi_ekf_slam

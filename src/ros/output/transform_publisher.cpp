#include "vi_ekf_slam/ros/output/transform_publisher.hpp"

#include <vector>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {

TransformPublisher::TransformPublisher(const RosConfig& config, double max_jump_back_s)
    : config_(config), max_jump_back_s_(max_jump_back_s) {}

bool TransformPublisher::publish(const Output& output, const std::string& imu_frame) {
  if (!config_.publish_tf || imu_frame.empty()) return false;
  const Stamp stamp = output.state.stamp;
  if (last_ && stamp <= *last_ && secondsBetween(stamp, *last_) <= max_jump_back_s_) return false;
  last_ = stamp;
  const SE3& map_T_imu = output.state.world_T_imu;
  std::vector<geometry_msgs::TransformStamped> transforms;
  if (config_.single_tf) {
    transforms.push_back(conversions::toTransform(map_T_imu, stamp, config_.map_frame, imu_frame));
  } else {
    const SE3 map_T_odom = map_T_imu * output.odom_T_imu.inverse();
    transforms.push_back(conversions::toTransform(map_T_odom, stamp, config_.map_frame, config_.odom_frame));
    if (config_.publish_odom_tf) {
      transforms.push_back(conversions::toTransform(output.odom_T_imu, stamp, config_.odom_frame, imu_frame));
    }
  }
  broadcaster_.sendTransform(transforms);
  return true;
}

} // namespace vi_ekf_slam

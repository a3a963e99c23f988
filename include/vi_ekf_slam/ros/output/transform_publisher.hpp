#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <ros/ros.h>

#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/ros/output/base_frame.hpp"
#include "vi_ekf_slam/ros/output/foreign_odometry.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Sends map -> odom -> base (REP 105), or what the configuration wants of it. A stamp that is not newer than
/// the last one is not sent, unless time was set back by more than `max_jump_s`, which is a new start.
class TransformPublisher {
 public:
  /// `frames` must outlive this.
  TransformPublisher(ros::NodeHandle nh, const FrameTree& frames, const RosConfig& config, double max_jump_s);

  void publish(Stamp stamp, const SE3& map_T_base, const SE3& odom_T_base, const BaseFrame& base);
  /// Whether the configuration has this transform sent.
  bool sends(const std::string& parent, const std::string& child, const BaseFrame& base) const;
  /// Whether the odometry is somebody else's.
  bool followsForeignOdometry() const;
  /// Looks whether somebody else publishes a parent of odom, beside which there must be no second one.
  void lookForParent(Stamp now);
  /// Why map -> odom may not be sent, and what to do; empty: it may, or is not to be.
  std::string problem() const;
  /// /tf has gone on.
  void noteTransforms(const BaseFrame& base);
  /// Poses that wait for somebody else's odometry.
  std::size_t waiting() const { return foreign_.waiting(); }
  void restart() { foreign_.restart(); }

 private:
  bool isNews(Stamp stamp);
  void send(std::vector<geometry_msgs::TransformStamped> transforms) const;

  const FrameTree& frames_;
  RosConfig config_;
  double max_jump_s_;
  std::string odom_parent_; ///< somebody else's
  ForeignOdometry foreign_;
  std::optional<Stamp> last_;
  /// tf2's broadcaster has a handle of its own, which does not know what a nodelet has remapped.
  ros::Publisher tf_;
};

} // namespace vi_ekf_slam

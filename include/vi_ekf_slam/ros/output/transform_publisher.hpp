#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <ros/ros.h>

#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/ros/input/frame_tree.hpp"
#include "vi_ekf_slam/ros/output/base_frame.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// map -> odom where somebody else owns odom -> base: map_T_base of a stamp times the inverse of what /tf
/// says of the same stamp. Poses wait until /tf has come to their stamp.
class ForeignOdometry {
 public:
  struct Correction {
    Stamp stamp;
    SE3 map_T_odom;
  };

  /// `frames` must outlive this.
  ForeignOdometry(const FrameTree& frames, std::string odom_frame)
      : frames_(frames), odom_frame_(std::move(odom_frame)) {}

  void add(Stamp stamp, const SE3& map_T_base);
  /// Of the newest pose for which /tf is there; those before it are let go of.
  std::optional<Correction> take(const std::string& base_frame);
  /// Poses that wait; what grows without end waits for a transform that nobody sends.
  std::size_t waiting() const { return poses_.size(); }
  void restart() { poses_.clear(); }

 private:
  static constexpr std::size_t kMostWaiting = 4000; // 10 s at 400 Hz, which is as long as /tf is kept

  struct Pose {
    Stamp stamp;
    SE3 map_T_base;
  };

  const FrameTree& frames_;
  std::string odom_frame_;
  std::deque<Pose> poses_;
};

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

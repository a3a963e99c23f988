#pragma once

#include <ros/ros.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/slam_system.hpp"
#include "vi_ekf_slam/ros/map_messages.hpp"
#include "vi_ekf_slam/ros/path_recorder.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"
#include "vi_ekf_slam/ros/transform_publisher.hpp"

namespace vi_ekf_slam {

/// Everything that the node sends. Stamps are those of the measurements; what is costly is built for
/// listeners only, and a listener that comes late gets the current path or map at once.
class Publishers {
 public:
  using LandmarkSource = std::function<std::vector<LandmarkEstimate>()>;

  Publishers(ros::NodeHandle nh, const RosConfig& config, double max_jump_back_s, LandmarkSource landmarks);

  /// odometry, pose, TF, paths and, after a frame when the period is over, the map.
  void publish(const Output& output, bool is_frame, const std::string& imu_frame);
  void publishMap();
  /// Paths and map are void.
  void reset();

 private:
  ros::Publisher advertisePath(const std::string& topic, const PathRecorder& path);
  void publishPaths(const Output& output);
  visualization_msgs::MarkerArray buildMarkers();

  ros::NodeHandle nh_;
  RosConfig config_;
  MarkerStyle style_;
  LandmarkSource landmarks_;
  TransformPublisher transforms_;
  PathRecorder path_;
  PathRecorder dead_reckoning_path_;
  std::optional<Stamp> last_stamp_;
  std::optional<Stamp> last_map_;
  std::size_t markers_shown_ = 0;
  ros::Publisher odometry_pub_;
  ros::Publisher pose_pub_;
  ros::Publisher path_pub_;
  ros::Publisher dead_reckoning_path_pub_;
  ros::Publisher markers_pub_;
  ros::Publisher cloud_pub_;
};

} // namespace vi_ekf_slam

#pragma once

#include <ros/ros.h>

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/output/map_messages.hpp"
#include "vi_ekf_slam/ros/output/pacer.hpp"
#include "vi_ekf_slam/ros/output/path_recorder.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"
#include "vi_ekf_slam/ros/output/transform_publisher.hpp"

namespace vi_ekf_slam {

/// Everything that the node sends. Stamps are those of the measurements; what is costly is built for
/// listeners only, and a listener that comes late gets the current path or map at once. All calls must come
/// from one thread; that of the callbacks may be another.
class Publishers {
 public:
  using LandmarkSource = std::function<std::vector<LandmarkEstimate>()>;

  Publishers(ros::NodeHandle nh, const RosConfig& config, double max_jump_back_s, LandmarkSource landmarks);

  /// odometry, pose, TF, paths and, after a frame when the period is over, the map.
  void publish(const Output& output, bool is_frame, const std::string& imu_frame);
  /// Paths and map as they are now, whatever was sent before.
  void publishAll();
  /// What was held back of the paths for the bandwidth's sake, when nothing more seems to come: at the same
  /// pace, by wall time.
  void publishUnsent();
  /// Sends paths and map to listeners that have come since the last call.
  void serveNewListeners();
  /// s of sensor time between two paths and two maps, byte/s of each topic.
  void setRates(double path_period_s, double landmark_period_s, double max_bandwidth_bytes_s);
  /// Paths and map are void.
  void reset();

 private:
  /// A path's points and how it is sent.
  struct PathOutput {
    PathRecorder path;
    Pacer pacer;
    ros::Publisher publisher;
    bool changed = false; ///< since it was sent
    ros::SteadyTime sent; ///< by wall time, for when sensor time stands still
  };

  template <typename Message>
  ros::Publisher advertiseLatched(const std::string& topic);
  PathOutput makePath(const std::string& topic);
  void sendPath(PathOutput& output);
  void sendMap();

  ros::NodeHandle nh_;
  RosConfig config_;
  MarkerStyle style_;
  LandmarkSource landmarks_;
  TransformPublisher transforms_;
  std::atomic<bool> listener_came_{false};
  PathOutput path_;
  PathOutput dead_reckoning_path_; ///< in the map frame too: as if nothing had corrected it
  Pacer map_pacer_;
  std::optional<Stamp> last_stamp_;
  std::size_t markers_shown_ = 0;
  ros::Publisher odometry_pub_;
  ros::Publisher pose_pub_;
  ros::Publisher markers_pub_;
  ros::Publisher cloud_pub_;
};

} // namespace vi_ekf_slam

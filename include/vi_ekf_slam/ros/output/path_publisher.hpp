#pragma once

#include "vi_ekf_slam/ros/output/latched_topic.hpp"
#include "vi_ekf_slam/ros/output/pacer.hpp"
#include "vi_ekf_slam/ros/output/path_recorder.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// A path's points, and when they are sent.
class PathPublisher {
 public:
  PathPublisher(ros::NodeHandle& nh, const std::string& topic, const RosConfig& config,
                std::atomic<bool>& listener_came);

  /// A pose in the map frame; sends the path when it is due.
  void add(Stamp stamp, const SE3& pose);
  /// A loop was closed: the whole path is another one, and is sent when the next pose is due.
  void correct(const PathEstimate& path) {
    path_.correct(path);
    changed_ = true;
  }
  void send();
  /// What was held back for the bandwidth's sake, at the same pace by wall time.
  void sendUnsent();
  void setRate(double period_s, double bytes_per_s) { pacer_.setRate(period_s, bytes_per_s); }
  void reset();

 private:
  PathRecorder path_;
  Pacer pacer_;
  ros::Publisher publisher_;
  std::optional<Stamp> last_;
  bool changed_ = false; ///< since it was sent
  ros::SteadyTime sent_; ///< by wall time, for when sensor time stands still
};

} // namespace vi_ekf_slam

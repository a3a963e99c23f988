#pragma once

#include <nav_msgs/Path.h>

#include <string>
#include <vector>

#include "vi_ekf_slam/core/map/path_estimate.hpp"
#include "vi_ekf_slam/ros/output/latched_topic.hpp"
#include "vi_ekf_slam/ros/output/pacer.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// A path that stays small: points at least a distance apart, and every second one dropped (the distance
/// doubled) when there are too many, so that the whole path stays visible.
class PathRecorder {
 public:
  /// `frame`: the path's header.frame_id; `min_distance_m` in m: a step of what is carried by hand. More
  /// points than `max_points` a screen does not show.
  explicit PathRecorder(std::string frame, std::size_t max_points = 10000, double min_distance_m = 0.05);

  /// Whether the pose became a point.
  bool add(Stamp stamp, const SE3& pose);
  /// All points are where the path has them, whatever they were corrected by before.
  void correct(const PathEstimate& path);
  void clear();
  const nav_msgs::Path& message() const { return path_; }

 private:
  void thin();

  std::size_t max_points_;
  double configured_distance_;
  double min_distance_;
  nav_msgs::Path path_;
  struct Added {
    Stamp stamp;
    SE3 pose;
  };
  std::vector<Added> added_; ///< the points as they were added
};

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

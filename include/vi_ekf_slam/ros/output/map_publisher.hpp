#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/ros/output/latched_topic.hpp"
#include "vi_ekf_slam/ros/output/map_messages.hpp"
#include "vi_ekf_slam/ros/output/pacer.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// The landmarks, as markers and as a cloud, the loops that were closed, and when all is sent.
class MapPublisher {
 public:
  /// In the map frame.
  using LandmarkSource = std::function<std::vector<LandmarkEstimate>()>;

  using PathSource = std::function<PathEstimate()>;

  MapPublisher(ros::NodeHandle& nh, const RosConfig& config, LandmarkSource landmarks, PathSource path,
               std::atomic<bool>& listener_came);

  bool isDue(Stamp stamp) const { return pacer_.isDue(stamp); }
  void send(Stamp stamp);
  void setRate(double period_s, double bytes_per_s) { pacer_.setRate(period_s, bytes_per_s); }
  /// The map is void; `stamp`: of what was sent last.
  void reset(std::optional<Stamp> stamp);

 private:
  std::string frame_; ///< the map's
  LandmarkSource landmarks_;
  PathSource path_;
  Pacer pacer_;
  std::size_t markers_shown_ = 0;
  ros::Publisher markers_;
  ros::Publisher cloud_;
};

} // namespace vi_ekf_slam

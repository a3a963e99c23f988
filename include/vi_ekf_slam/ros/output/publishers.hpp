#pragma once

#include <ros/ros.h>

#include <atomic>
#include <optional>
#include <string>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/output/base_frame.hpp"
#include "vi_ekf_slam/ros/output/map_publisher.hpp"
#include "vi_ekf_slam/ros/output/path_publisher.hpp"
#include "vi_ekf_slam/ros/output/smooth_odometry.hpp"
#include "vi_ekf_slam/ros/output/transform_publisher.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Everything that the node sends. Stamps are those of the measurements; what is costly is built for
/// listeners only, and a listener that comes late gets the current path or map at once. All calls must come
/// from one thread; that of the callbacks may be another.
class Publishers {
 public:
  /// `frames` must outlive this; `landmarks` and `path`: in the estimator's world.
  Publishers(ros::NodeHandle nh, const RosConfig& config, double max_jump_s, const FrameTree& frames,
             MapPublisher::LandmarkSource landmarks, MapPublisher::PathSource path);

  /// Odometry, pose, TF, paths and, after a frame when the period is over, the map; nothing as long as the
  /// base frame is not known.
  void publish(const Output& output, bool is_frame);
  /// Whether the base frame is known, see BaseFrame::update.
  bool findBase(const std::string& imu_frame, const std::optional<SE3>& start) {
    return base_.update(imu_frame, start);
  }
  /// /tf or /tf_static have said more.
  void noteTransforms() {
    base_.noteTransforms();
    transforms_.noteTransforms(base_);
  }
  /// Whether this is a transform that is sent here.
  bool sends(const std::string& parent, const std::string& child) const {
    return transforms_.sends(parent, child, base_);
  }
  /// Why something is not published, and what to do; empty: all is.
  std::string problem() const;
  const BaseFrame& base() const { return base_; }
  /// See SmoothOdometry::motionSince.
  SE3 motionSince(Stamp then) const { return smooth_.motionSince(then); }

  /// Paths and map as they are now, whatever was sent before.
  void publishAll();
  /// What was held back of the paths for the bandwidth's sake, when nothing more seems to come: at the same
  /// pace, by wall time.
  void publishUnsent();
  /// Sends paths and map to listeners that have come since the last call.
  void serveNewListeners();
  /// s of sensor time between two paths and two maps, byte/s of each topic.
  void setRates(double path_period_s, double landmark_period_s, double max_bandwidth_bytes_s);
  /// Paths and map are void: poses are in another frame from now on.
  void reset();
  /// The dead reckoning has begun anew too; the odometry goes on from where it was.
  void restart();

 private:
  void publishLoop(const ClosedLoop& of_imu);

  RosConfig config_;
  BaseFrame base_;
  SmoothOdometry smooth_;
  TransformPublisher transforms_;
  std::atomic<bool> listener_came_{false};
  PathPublisher path_;
  PathPublisher dead_reckoning_path_; ///< in the map frame too: as if nothing had corrected it
  MapPublisher::PathSource path_source_;
  MapPublisher map_;
  std::optional<Stamp> last_stamp_;
  ros::Publisher odometry_, dead_reckoning_, pose_, loops_;
};

} // namespace vi_ekf_slam

#include "vi_ekf_slam/ros/publishers.hpp"

#include <utility>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {

Publishers::Publishers(ros::NodeHandle nh, const RosConfig& config, double max_jump_back_s,
                       LandmarkSource landmarks)
    : nh_(std::move(nh)),
      config_(config),
      style_{config.map_frame, config.landmark_size_m, config.landmark_sigma_red_m},
      landmarks_(std::move(landmarks)),
      transforms_(config, max_jump_back_s),
      path_(config.map_frame, config.path_max_points, config.path_min_distance_m),
      // In the map frame too: as if nothing had corrected it, which is what one wants to see beside the path.
      dead_reckoning_path_(config.map_frame, config.path_max_points, config.path_min_distance_m) {
  const auto queue = static_cast<std::uint32_t>(config.output_queue_size);
  odometry_pub_ = nh_.advertise<nav_msgs::Odometry>("odometry", queue);
  pose_pub_ = nh_.advertise<geometry_msgs::PoseWithCovarianceStamped>("pose", queue);
  path_pub_ = advertisePath("path", path_);
  dead_reckoning_path_pub_ = advertisePath("dead_reckoning/path", dead_reckoning_path_);
  markers_pub_ = nh_.advertise<visualization_msgs::MarkerArray>(
      "landmarks", queue,
      [this](const ros::SingleSubscriberPublisher& listener) {
        if (last_stamp_) listener.publish(buildMarkers());
      },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
  cloud_pub_ = nh_.advertise<sensor_msgs::PointCloud2>(
      "landmark_cloud", queue,
      [this](const ros::SingleSubscriberPublisher& listener) {
        if (last_stamp_) listener.publish(toCloud(landmarks_(), *last_stamp_, config_.map_frame));
      },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
}

ros::Publisher Publishers::advertisePath(const std::string& topic, const PathRecorder& path) {
  return nh_.advertise<nav_msgs::Path>(
      topic, static_cast<std::uint32_t>(config_.output_queue_size),
      [&path](const ros::SingleSubscriberPublisher& listener) {
        if (!path.message().poses.empty()) listener.publish(path.message());
      },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
}

void Publishers::publish(const Output& output, bool is_frame, const std::string& imu_frame) {
  const Stamp stamp = output.state.stamp;
  last_stamp_ = stamp;
  transforms_.publish(output, imu_frame);
  odometry_pub_.publish(conversions::toOdometry(output.state, config_.map_frame, imu_frame));
  if (pose_pub_.getNumSubscribers() > 0) {
    pose_pub_.publish(conversions::toPoseMessage(output.state, config_.map_frame));
  }
  publishPaths(output);
  if (is_frame && (!last_map_ || secondsBetween(*last_map_, stamp) >= config_.landmark_period_s)) {
    last_map_ = stamp;
    publishMap();
  }
}

void Publishers::publishPaths(const Output& output) {
  const Stamp stamp = output.state.stamp;
  if (path_.add(stamp, output.state.world_T_imu) && path_pub_.getNumSubscribers() > 0) {
    path_pub_.publish(path_.message());
  }
  if (dead_reckoning_path_.add(stamp, output.odom_T_imu) &&
      dead_reckoning_path_pub_.getNumSubscribers() > 0) {
    dead_reckoning_path_pub_.publish(dead_reckoning_path_.message());
  }
}

visualization_msgs::MarkerArray Publishers::buildMarkers() {
  const auto landmarks = landmarks_();
  auto markers = toMarkers(landmarks, *last_stamp_, style_, markers_shown_);
  markers_shown_ = (landmarks.size() + kMaxPointsPerMarker - 1) / kMaxPointsPerMarker;
  return markers;
}

void Publishers::publishMap() {
  if (!last_stamp_) return;
  if (markers_pub_.getNumSubscribers() > 0) markers_pub_.publish(buildMarkers());
  if (cloud_pub_.getNumSubscribers() > 0) {
    cloud_pub_.publish(toCloud(landmarks_(), *last_stamp_, config_.map_frame));
  }
}

void Publishers::reset() {
  path_.clear();
  dead_reckoning_path_.clear();
  last_map_.reset();
  markers_shown_ = 0;
  markers_pub_.publish(deleteAllMarkers(config_.map_frame));
  if (last_stamp_) cloud_pub_.publish(toCloud({}, *last_stamp_, config_.map_frame));
  path_pub_.publish(path_.message());
  dead_reckoning_path_pub_.publish(dead_reckoning_path_.message());
}

} // namespace vi_ekf_slam

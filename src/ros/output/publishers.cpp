#include "vi_ekf_slam/ros/output/publishers.hpp"

#include <ros/serialization.h>

#include <utility>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::uint32_t kQueue = 10; // messages held for a listener; one that is slower wants the newest

} // namespace

Publishers::Publishers(ros::NodeHandle nh, const RosConfig& config, double max_jump_back_s,
                       LandmarkSource landmarks)
    : nh_(std::move(nh)),
      config_(config),
      style_{config.map_frame},
      landmarks_(std::move(landmarks)),
      transforms_(config, max_jump_back_s),
      path_(makePath("path")),
      dead_reckoning_path_(makePath("dead_reckoning/path")),
      map_pacer_(config.landmark_period_s, config.max_bandwidth_bytes_s) {
  odometry_pub_ = nh_.advertise<nav_msgs::Odometry>("odometry", kQueue);
  pose_pub_ = nh_.advertise<geometry_msgs::PoseWithCovarianceStamped>("pose", kQueue);
  markers_pub_ = advertiseLatched<visualization_msgs::MarkerArray>("landmarks");
  cloud_pub_ = advertiseLatched<sensor_msgs::PointCloud2>("landmark_cloud");
}

/// A new listener is only noted: its callback runs beside the thread that owns paths and map.
template <typename Message>
ros::Publisher Publishers::advertiseLatched(const std::string& topic) {
  return nh_.advertise<Message>(
      topic, kQueue, [this](const ros::SingleSubscriberPublisher& /*listener*/) { listener_came_ = true; },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
}

Publishers::PathOutput Publishers::makePath(const std::string& topic) {
  return {PathRecorder(config_.map_frame, config_.path_max_points),
          Pacer(config_.path_period_s, config_.max_bandwidth_bytes_s),
          advertiseLatched<nav_msgs::Path>(topic),
          false,
          {}};
}

void Publishers::publish(const Output& output, bool is_frame, const std::string& imu_frame) {
  const Stamp stamp = output.state.stamp;
  last_stamp_ = stamp;
  transforms_.publish(output, imu_frame);
  if (odometry_pub_.getNumSubscribers() > 0) {
    odometry_pub_.publish(conversions::toOdometry(output.state, config_.map_frame, imu_frame));
  }
  if (pose_pub_.getNumSubscribers() > 0) {
    pose_pub_.publish(conversions::toPoseMessage(output.state, config_.map_frame));
  }
  path_.changed |= path_.path.add(stamp, output.state.world_T_imu);
  dead_reckoning_path_.changed |= dead_reckoning_path_.path.add(stamp, output.odom_T_imu);
  for (PathOutput* path : {&path_, &dead_reckoning_path_}) {
    if (path->changed && path->pacer.isDue(stamp)) sendPath(*path);
  }
  if (is_frame && map_pacer_.isDue(stamp)) sendMap();
}

void Publishers::sendPath(PathOutput& output) {
  if (output.publisher.getNumSubscribers() == 0) return;
  output.publisher.publish(output.path.message());
  output.pacer.noteSent(*last_stamp_, ros::serialization::serializationLength(output.path.message()));
  output.changed = false;
  output.sent = ros::SteadyTime::now();
}

void Publishers::sendMap() {
  const bool markers_wanted = markers_pub_.getNumSubscribers() > 0;
  const bool cloud_wanted = cloud_pub_.getNumSubscribers() > 0;
  if (!markers_wanted && !cloud_wanted) return;
  const auto landmarks = landmarks_();
  std::size_t bytes = 0; // of the larger topic
  if (markers_wanted) {
    const auto markers = toMarkers(landmarks, *last_stamp_, style_, markers_shown_);
    markers_shown_ = (landmarks.size() + kMaxPointsPerMarker - 1) / kMaxPointsPerMarker;
    bytes = ros::serialization::serializationLength(markers);
    markers_pub_.publish(markers);
  }
  if (cloud_wanted) {
    const auto cloud = toCloud(landmarks, *last_stamp_, config_.map_frame);
    bytes = std::max<std::size_t>(bytes, ros::serialization::serializationLength(cloud));
    cloud_pub_.publish(cloud);
  }
  map_pacer_.noteSent(*last_stamp_, bytes);
}

void Publishers::publishAll() {
  if (!last_stamp_) return;
  sendPath(path_);
  sendPath(dead_reckoning_path_);
  sendMap();
}

void Publishers::publishUnsent() {
  for (PathOutput* path : {&path_, &dead_reckoning_path_}) {
    const bool due = (ros::SteadyTime::now() - path->sent).toSec() >= path->pacer.wait();
    if (path->changed && last_stamp_ && due) sendPath(*path);
  }
}

void Publishers::serveNewListeners() {
  if (listener_came_.exchange(false)) publishAll();
}

void Publishers::setRates(double path_period_s, double landmark_period_s, double max_bandwidth_bytes_s) {
  for (PathOutput* path : {&path_, &dead_reckoning_path_}) {
    path->pacer.setRate(path_period_s, max_bandwidth_bytes_s);
  }
  map_pacer_.setRate(landmark_period_s, max_bandwidth_bytes_s);
}

void Publishers::reset() {
  markers_shown_ = 0;
  map_pacer_.restart();
  markers_pub_.publish(deleteAllMarkers(config_.map_frame));
  if (last_stamp_) cloud_pub_.publish(toCloud({}, *last_stamp_, config_.map_frame));
  for (PathOutput* path : {&path_, &dead_reckoning_path_}) {
    path->path.clear();
    path->pacer.restart();
    path->changed = false;
    path->publisher.publish(path->path.message());
  }
}

} // namespace vi_ekf_slam

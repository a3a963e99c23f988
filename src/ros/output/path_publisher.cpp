#include "vi_ekf_slam/ros/output/path_publisher.hpp"

#include <ros/serialization.h>

#include <cmath>
#include <utility>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {

PathRecorder::PathRecorder(std::string frame, std::size_t max_points, double min_distance_m)
    : max_points_(max_points), configured_distance_(min_distance_m), min_distance_(min_distance_m) {
  path_.header.frame_id = std::move(frame);
}

bool PathRecorder::add(Stamp stamp, const SE3& pose) {
  geometry_msgs::PoseStamped point;
  point.header = conversions::toHeader(stamp, path_.header.frame_id);
  point.pose = conversions::toPose(pose);
  if (!path_.poses.empty()) {
    const auto& last = path_.poses.back().pose.position;
    const auto& next = point.pose.position;
    if (std::hypot(next.x - last.x, next.y - last.y, next.z - last.z) < min_distance_) return false;
  }
  path_.poses.push_back(point);
  added_.push_back({stamp, pose});
  path_.header.stamp = point.header.stamp;
  if (path_.poses.size() > max_points_) thin();
  return true;
}

void PathRecorder::thin() {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < path_.poses.size(); i += 2, ++kept) {
    path_.poses[kept] = path_.poses[i];
    added_[kept] = added_[i];
  }
  path_.poses.resize(kept);
  added_.resize(kept);
  min_distance_ *= 2.0;
}

void PathRecorder::correct(const PathEstimate& path) {
  for (std::size_t i = 0; i < added_.size(); ++i) {
    const SE3 now = path.at(added_[i].stamp, added_[i].pose, Matrix6d::Zero()).world_T_imu;
    path_.poses[i].pose = conversions::toPose(now);
  }
}

void PathRecorder::clear() {
  path_.poses.clear();
  added_.clear();
  min_distance_ = configured_distance_;
}

PathPublisher::PathPublisher(ros::NodeHandle& nh, const std::string& topic, const RosConfig& config,
                             std::atomic<bool>& listener_came)
    : path_(config.map_frame),
      pacer_(config.path_period_s, config.max_bandwidth_bytes_s),
      publisher_(advertiseLatched<nav_msgs::Path>(nh, topic, listener_came)) {}

void PathPublisher::add(Stamp stamp, const SE3& pose) {
  last_ = stamp;
  changed_ |= path_.add(stamp, pose);
  if (changed_ && pacer_.isDue(stamp)) send();
}

void PathPublisher::send() {
  if (!last_ || publisher_.getNumSubscribers() == 0) return;
  publisher_.publish(path_.message());
  pacer_.noteSent(*last_, ros::serialization::serializationLength(path_.message()));
  changed_ = false;
  sent_ = ros::SteadyTime::now();
}

void PathPublisher::sendUnsent() {
  const bool due = (ros::SteadyTime::now() - sent_).toSec() >= pacer_.wait();
  if (changed_ && due) send();
}

void PathPublisher::reset() {
  path_.clear();
  pacer_.restart();
  changed_ = false;
  publisher_.publish(path_.message());
}

} // namespace vi_ekf_slam

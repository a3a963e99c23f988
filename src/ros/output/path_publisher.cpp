#include "vi_ekf_slam/ros/output/path_publisher.hpp"

#include <ros/serialization.h>

namespace vi_ekf_slam {

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

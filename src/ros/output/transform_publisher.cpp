#include "vi_ekf_slam/ros/output/transform_publisher.hpp"

#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {

using conversions::toTransform;

void ForeignOdometry::add(Stamp stamp, const SE3& map_T_base) {
  poses_.push_back({stamp, map_T_base});
  if (poses_.size() > kMostWaiting) poses_.pop_front();
}

std::optional<ForeignOdometry::Correction> ForeignOdometry::take(const std::string& base_frame) {
  const auto newest = poses_.empty() ? std::nullopt : frames_.newest(odom_frame_, base_frame);
  if (!newest) return std::nullopt;
  const auto after = *newest == 0 ? poses_.end()
                                  : std::upper_bound(poses_.begin(), poses_.end(), *newest,
                                                     [](Stamp s, const Pose& p) { return s < p.stamp; });
  if (after == poses_.begin()) return std::nullopt;
  const Pose pose = *std::prev(after);
  poses_.erase(poses_.begin(), after);
  const auto odom_T_base = frames_.find(odom_frame_, base_frame, pose.stamp);
  if (!odom_T_base) return std::nullopt; // older than what is kept of /tf
  return Correction{pose.stamp, (pose.map_T_base * odom_T_base->inverse()).normalized()};
}

TransformPublisher::TransformPublisher(ros::NodeHandle nh, const FrameTree& frames, const RosConfig& config,
                                       double max_jump_s)
    : frames_(frames),
      config_(config),
      max_jump_s_(max_jump_s),
      foreign_(frames, config.odom_frame),
      tf_(nh.advertise<tf2_msgs::TFMessage>("/tf", 100)) {}

void TransformPublisher::send(std::vector<geometry_msgs::TransformStamped> transforms) const {
  tf2_msgs::TFMessage message;
  message.transforms = std::move(transforms);
  tf_.publish(message);
}

bool TransformPublisher::followsForeignOdometry() const {
  return config_.publish_tf && config_.publish_map_tf && !config_.publish_odom_tf && !config_.single_tf;
}

bool TransformPublisher::sends(const std::string& parent, const std::string& child,
                               const BaseFrame& base) const {
  if (!config_.publish_tf) return false;
  if (config_.single_tf) return parent == config_.map_frame && child == base.name();
  return (config_.publish_map_tf && parent == config_.map_frame && child == config_.odom_frame) ||
         (config_.publish_odom_tf && parent == config_.odom_frame && child == base.name());
}

void TransformPublisher::lookForParent(Stamp now) {
  const bool sends_odom = config_.publish_tf && config_.publish_map_tf && !config_.single_tf;
  odom_parent_ = sends_odom ? frames_.parentOf(config_.odom_frame, now) : std::string();
}

std::string TransformPublisher::problem() const {
  if (odom_parent_.empty()) return {};
  const std::string to_odom = "' -> '" + config_.odom_frame + "'";
  return "'" + config_.map_frame + to_odom + " is not published, since somebody else publishes '" +
         odom_parent_ + to_odom + ": set ros/publish_map_tf to false, if that is another localisation, " +
         "or give ros/odom_frame another name";
}

bool TransformPublisher::isNews(Stamp stamp) {
  if (last_ && stamp <= *last_ && secondsBetween(stamp, *last_) <= max_jump_s_) return false;
  last_ = stamp;
  return true;
}

void TransformPublisher::publish(Stamp stamp, const SE3& map_T_base, const SE3& odom_T_base,
                                 const BaseFrame& base) {
  if (!config_.publish_tf) return;
  if (followsForeignOdometry()) {
    foreign_.add(stamp, map_T_base);
    noteTransforms(base);
    return;
  }
  if (!base.mayGetParent() || !isNews(stamp)) return;
  if (config_.single_tf) {
    send({toTransform(map_T_base, stamp, config_.map_frame, base.name())});
    return;
  }
  std::vector<geometry_msgs::TransformStamped> transforms;
  const Stamp later = stamp + fromSeconds(config_.transform_tolerance);
  if (config_.publish_map_tf && odom_parent_.empty())
    transforms.push_back(
        toTransform(map_T_base * odom_T_base.inverse(), later, config_.map_frame, config_.odom_frame));
  if (config_.publish_odom_tf)
    transforms.push_back(toTransform(odom_T_base, stamp, config_.odom_frame, base.name()));
  if (!transforms.empty()) send(std::move(transforms));
}

void TransformPublisher::noteTransforms(const BaseFrame& base) {
  if (!followsForeignOdometry() || base.name().empty() || !odom_parent_.empty()) return;
  const auto correction = foreign_.take(base.name());
  if (!correction || !isNews(correction->stamp)) return;
  const Stamp later = correction->stamp + fromSeconds(config_.transform_tolerance);
  send({toTransform(correction->map_T_odom, later, config_.map_frame, config_.odom_frame)});
}

} // namespace vi_ekf_slam

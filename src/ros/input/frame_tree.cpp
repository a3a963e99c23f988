#include "vi_ekf_slam/ros/input/frame_tree.hpp"

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {

bool hasMoved(const SE3& before, const SE3& now) {
  constexpr double kRounding = 1e-3; // m, rad
  const SE3 change = before.inverse() * now;
  return change.translation().norm() > kRounding || so3::Log(change.rotation()).norm() > kRounding;
}

void FrameTree::add(const tf2_msgs::TFMessage& message, bool is_static) {
  for (geometry_msgs::TransformStamped transform : message.transforms) {
    transform.header.frame_id = conversions::frameName(transform.header.frame_id);
    transform.child_frame_id = conversions::frameName(transform.child_frame_id);
    buffer_.setTransform(transform, "vi_ekf_slam", is_static);
  }
}

std::optional<SE3> FrameTree::find(const std::string& target, const std::string& source, Stamp stamp) const {
  if (target.empty() || source.empty()) return std::nullopt;
  if (target == source) return SE3();
  const ros::Time time = conversions::toTime(stamp);
  if (!buffer_.canTransform(target, source, time)) return std::nullopt;
  return conversions::toSE3(buffer_.lookupTransform(target, source, time).transform);
}

std::optional<Stamp> FrameTree::newest(const std::string& target, const std::string& source) const {
  if (!find(target, source)) return std::nullopt;
  if (target == source) return 0;
  return conversions::toStamp(buffer_.lookupTransform(target, source, ros::Time(0)).header.stamp);
}

std::string FrameTree::parentOf(const std::string& frame, Stamp now) const {
  constexpr double kLongest = 5.0; // s from one transform to the next
  std::string parent;
  if (frame.empty() || !buffer_._getParent(frame, ros::Time(0), parent)) return {};
  const Stamp last = newest(parent, frame).value_or(0);
  return last == 0 || secondsBetween(last, now) <= kLongest ? parent : std::string();
}

} // namespace vi_ekf_slam

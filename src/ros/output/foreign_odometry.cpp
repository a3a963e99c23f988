#include "vi_ekf_slam/ros/output/foreign_odometry.hpp"

#include <algorithm>
#include <iterator>

namespace vi_ekf_slam {

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
  const auto odom_T_base = frames_.findAt(odom_frame_, base_frame, pose.stamp);
  if (!odom_T_base) return std::nullopt; // older than what is kept of /tf
  return Correction{pose.stamp, (pose.map_T_base * odom_T_base->inverse()).normalized()};
}

} // namespace vi_ekf_slam

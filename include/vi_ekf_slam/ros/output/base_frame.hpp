#pragma once

#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/slam/estimator.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// The frame whose pose goes out, and the map that begins at its first pose: what the estimator says of the
/// IMU in its world said of the base. With B = base_T_imu, constant, map_T_base = M world_T_imu B^-1, and
/// points of the world are at M of where they are. M = B start^-1, of the IMU's pose at the start, but in a
/// world whose z axis points up, which stays so: there M turns by B's heading alone, so that a base that
/// begins level begins at the map's origin, heading along its x axis.
class BaseFrame {
 public:
  /// `frames` must outlive this.
  BaseFrame(const FrameTree& frames, const RosConfig& config) : frames_(frames), config_(config) {}

  /// Whether the transform between the two is known now; the first one that was holds, and so does `start`,
  /// the IMU's pose in the world at the start; nothing: the world's z axis points up. Another frame, or a
  /// world that points up from now on, begins anew: an IMU has come late.
  bool update(const std::string& imu_frame, const std::optional<SE3>& start);
  /// Why it is not known, or why no odom -> base may be sent, and what to do; empty: all is well.
  std::string problem() const;
  /// Looks whether the transform, which is to be constant, is another one now.
  void noteTransforms();
  /// That it was, in words; empty: it was not.
  std::string change() const;
  /// Of the frame; empty as long as nothing is known.
  const std::string& name() const { return name_; }
  /// Looks whether somebody else publishes a parent of the frame, beside which there must be no second one.
  void lookForParent(Stamp now) { foreign_parent_ = frames_.parentOf(name_, now); }
  /// Whether a transform from odom or map to the frame makes a tree.
  bool mayGetParent() const { return foreign_parent_.empty() && !isImuOfWorld(); }

  /// M of above.
  const SE3& mapFromWorld() const { return map_T_world_; }
  SE3 pose(const SE3& world_T_imu) const;
  /// The inverse of pose: where the IMU is in the world when the base is at `map_T_base`.
  SE3 imuPose(const SE3& map_T_base) const;
  /// Pose and twist with their covariances.
  StateEstimate state(const StateEstimate& of_imu) const;
  /// Of the IMU's pose in the world, from that of the base's in the map; both along the fixed axes.
  Matrix6d imuCovariance(const SE3& map_T_base, const Matrix6d& covariance) const;
  /// The same of all of a path, and of a loop.
  PathEstimate path(PathEstimate of_imu) const;
  ClosedLoop loop(ClosedLoop of_imu) const;
  std::vector<LandmarkEstimate> landmarks(std::vector<LandmarkEstimate> in_world) const;

 private:
  bool isImuOfWorld() const { return imu_frame_ == config_.map_frame || imu_frame_ == config_.odom_frame; }

  const FrameTree& frames_;
  RosConfig config_;
  std::string imu_frame_;
  bool has_start_ = false;
  std::string name_;
  std::string foreign_parent_;
  bool has_changed_ = false;
  std::optional<SE3> base_T_imu_; ///< nothing: the IMU itself, or not known
  SE3 map_T_world_;
};

} // namespace vi_ekf_slam

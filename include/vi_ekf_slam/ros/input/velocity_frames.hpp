#pragma once

#include <map>
#include <string>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Turns velocities of any frame of the vehicle to the axes of the IMU, with their lever arms. The first
/// transform that is known of a frame holds, so that what is computed does not depend on when messages come.
class VelocityFrames {
 public:
  /// `frames` must outlive this.
  VelocityFrames(const FrameTree& frames, const RosConfig& config)
      : frames_(frames), map_frame_(config.map_frame), odom_frame_(config.odom_frame) {}

  void setImuFrame(const std::string& imu_frame) {
    imu_frame_ = imu_frame;
    imu_T_frame_.clear();
  }

  /// Whether `sample`, along the axes and of the origin of `frame`, is along the IMU's now.
  bool carry(VelocitySample& sample, const std::string& frame);
  /// Whether no transform can ever make a velocity of this frame usable.
  bool isImpossible(const std::string& frame) const { return frame == map_frame_ || frame == odom_frame_; }
  /// Why carry says no, and what to do.
  std::string problem(const std::string& frame) const;

 private:
  static constexpr std::size_t kMostFrames = 50; // of a vehicle; more are a fault, and not to fill the memory

  const FrameTree& frames_;
  std::string map_frame_, odom_frame_, imu_frame_;
  std::map<std::string, SE3> imu_T_frame_; ///< by frame
};

} // namespace vi_ekf_slam

#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <utility>

#include "vi_ekf_slam/ros/input/frame_tree.hpp"

namespace vi_ekf_slam {

/// map -> odom where somebody else owns odom -> base: map_T_base of a stamp times the inverse of what /tf
/// says of the same stamp. Poses wait until /tf has come to their stamp.
class ForeignOdometry {
 public:
  struct Correction {
    Stamp stamp;
    SE3 map_T_odom;
  };

  /// `frames` must outlive this.
  ForeignOdometry(const FrameTree& frames, std::string odom_frame)
      : frames_(frames), odom_frame_(std::move(odom_frame)) {}

  void add(Stamp stamp, const SE3& map_T_base);
  /// Of the newest pose for which /tf is there; those before it are let go of.
  std::optional<Correction> take(const std::string& base_frame);
  /// Poses that wait; what grows without end waits for a transform that nobody sends.
  std::size_t waiting() const { return poses_.size(); }
  void restart() { poses_.clear(); }

 private:
  static constexpr std::size_t kMostWaiting = 4000; // 10 s at 400 Hz, which is as long as /tf is kept

  struct Pose {
    Stamp stamp;
    SE3 map_T_base;
  };

  const FrameTree& frames_;
  std::string odom_frame_;
  std::deque<Pose> poses_;
};

} // namespace vi_ekf_slam

#pragma once

#include <tf2/buffer_core.h>
#include <tf2_msgs/TFMessage.h>

#include <optional>
#include <string>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

constexpr double kVehicleSize = 100.0; ///< m; what is farther away is no part of a vehicle

/// Whether a transform that is to be constant is another one `now`, by more than rounding makes of it.
bool hasMoved(const SE3& before, const SE3& now);

/// What /tf and /tf_static have said: static transforms for ever, others for 10 s.
class FrameTree {
 public:
  void add(const tf2_msgs::TFMessage& message, bool is_static);
  /// Time begins anew: forgets what is not static.
  void restart() { buffer_.clear(); }

  /// target_T_source at a stamp, interpolated (0: the newest that is known); nothing where nothing connects
  /// the two, or where it is not known of that time (yet).
  std::optional<SE3> find(const std::string& target, const std::string& source, Stamp stamp = 0) const;
  /// Up to which the two are known (0: for ever); nothing where they are not.
  std::optional<Stamp> newest(const std::string& target, const std::string& source) const;
  /// That somebody publishes still: its transform is static, or not older than some seconds; empty: none.
  std::string parentOf(const std::string& frame, Stamp now) const;

 private:
  tf2::BufferCore buffer_;
};

} // namespace vi_ekf_slam

#pragma once

#include <functional>
#include <optional>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Decides which results leave the node, so that a stamp has one pose: the corrected one.
///
/// Gyro samples and frames often share stamps, and the system processes equal stamps in the order gyro,
/// velocity, stereo. A gyro result is therefore held back until a later result shows that no frame of the
/// same stamp follows, or until the system has nothing more that is due (endOfDrain). A frame replaces the
/// gyro result of its stamp. With every stream alive the frame is due together with the gyro sample, so
/// nothing waits longer for this.
///
/// At the rate of the frames, results of IMU samples leave only while no frame comes for 1 s.
class OutputSequencer {
 public:
  /// `is_frame`: the result of a stereo frame, not of a gyro sample.
  using Sink = std::function<void(const Output& output, bool is_frame)>;

  explicit OutputSequencer(Sink sink, OdometryRate rate = OdometryRate::kImu)
      : sink_(std::move(sink)), rate_(rate) {}

  void add(const Output& output, bool is_frame);
  /// The system has returned: what was held back leaves now.
  void endOfDrain();

 private:
  Sink sink_;
  OdometryRate rate_;
  std::optional<Stamp> last_frame_;
  std::optional<Output> held_;
};

} // namespace vi_ekf_slam

#pragma once

#include <functional>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/sensors/imu_rate.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"

namespace vi_ekf_slam {

/// Which motion model it is to be: the configured one, or by what the IMU's first messages have.
class MotionSelection {
 public:
  explicit MotionSelection(const Config& config);

  /// kAuto as long as nothing has decided.
  MotionChoice choice() const { return choice_; }
  bool isOpen() const { return choice_ == MotionChoice::kAuto; }
  bool isInertial() const { return choice_ == MotionChoice::kInertial; }
  /// "inertial, the IMU's messages carry accelerations"; empty as long as it is open, and for the paper's
  /// filter.
  const std::string& text() const { return text_; }

  /// Called once something has decided that the configuration left open.
  void onDecision(std::function<void()> handler) { on_decision_ = std::move(handler); }

  // Nothing, once it is decided:
  /// The next sample of the IMU as it comes, of which one or a few decide; also where it was decided that
  /// there is none, since a driver may start late.
  void note(const ImuSample& sample);
  /// Nothing more is waited for.
  void close();
  void decide(MotionChoice choice, const std::string& reason);

 private:
  void become(MotionChoice choice, const std::string& reason);

  MotionChoice choice_;
  bool lacks_imu_ = false; ///< which is why it is a constant twist
  int without_acceleration_ = 0; ///< samples
  std::string text_;
  ImuRate imu_rate_; ///< of the first samples
  std::function<void()> on_decision_;
};

} // namespace vi_ekf_slam

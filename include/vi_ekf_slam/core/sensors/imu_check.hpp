#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/sensors/saturation.hpp"

namespace vi_ekf_slam {

/// Looks whether an IMU's samples are what an IMU's must be, and says what is wrong once, in words with the
/// values and what is allowed. Nothing is dropped for it.
class ImuCheck {
 public:
  struct Counts {
    std::uint64_t stutters = 0;  ///< intervals that are not the usual one
    std::uint64_t backwards = 0; ///< samples that came after a later one
    std::uint64_t stops = 0;     ///< times without samples while frames came
  };

  /// `gravity`, m/s^2.
  explicit ImuCheck(double gravity) : gravity_(gravity) {}

  /// Called when something is found, once each, but for each stop and its end.
  void onProblem(std::function<void(const std::string&)> handler) { handler_ = std::move(handler); }

  /// A sample has come; not yet sorted.
  void arrived(Stamp stamp);
  /// The next one in the order of stamps; `inertial`: its acceleration is used.
  void note(const ImuSample& sample, bool inertial);
  /// A frame in the order of stamps.
  void noteFrame(Stamp stamp);
  /// Time begins anew; counts stay.
  void restart();

  const Counts& counts() const { return counts_; }
  /// What is wrong now, in words; empty: nothing.
  std::string problem() const;

 private:
  enum Fault { kAcceleration, kRate, kGyroRange, kAccelerometerRange, kStutter, kStopped, kFaultCount };

  void say(const std::string& text) const {
    if (handler_) handler_(text);
  }
  void find(Fault fault, const std::string& text) { say(faults_[fault] = text); }
  void noteInterval(Stamp from, Stamp to);
  void noteRate(const ImuSample& sample);
  void noteAcceleration(const ImuSample& sample);
  void noteRange(Fault fault, const Eigen::Vector3d& value);
  std::string accelerationProblem() const;

  double gravity_;
  std::function<void(const std::string&)> handler_;
  Counts counts_;
  std::array<std::string, kFaultCount> faults_;
  std::optional<Stamp> arrived_, last_, first_;
  std::size_t frames_alone_ = 0; ///< since the last sample
  bool told_stutter_ = false;
  std::deque<double> intervals_; ///< s, of the last while
  std::deque<bool> odd_;         ///< those of them that are not the usual one
  std::size_t samples_ = 0, accelerated_ = 0;
  double norms_ = 0.0; ///< m/s^2, sum
  bool accelerations_judged_ = false;
  std::size_t impossible_ = 0; ///< samples whose rate no gyro says
  std::array<Saturation, 3> gyro_axes_, accelerometer_axes_;
};

} // namespace vi_ekf_slam

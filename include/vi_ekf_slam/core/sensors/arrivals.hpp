#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/sensors/clock_guard.hpp"
#include "vi_ekf_slam/core/sensors/measurement_buffer.hpp"

namespace vi_ekf_slam {

/// A faster measurement is no motion of a vehicle but a fault; far faster ones would overflow the filter.
constexpr double kMaxSpeed = 1e3;        ///< m/s
constexpr double kMaxAngularSpeed = 1e3; ///< rad/s
constexpr double kMaxAcceleration = 1e4; ///< m/s^2

/// Measurements that were not processed, by stream and reason.
struct ArrivalCounts {
  using PerStream = std::array<std::uint64_t, kStreamCount>;
  PerStream late{}, duplicate{};
  PerStream ahead{}, behind{}; ///< a stamp far ahead of all others or behind them, not confirmed
  PerStream invalid{};         ///< not finite, too fast, or a covariance that is none
  PerStream too_fast{};        ///< of the invalid: beyond kMaxSpeed and the like
  PerStream bad_covariance{};  ///< of the invalid: not symmetric positive definite
};

/// Measurements from when they come to when they are processed: those that are none are dropped, a clock that
/// has jumped is told from a stamp that is wrong (ClockGuard), and all wait for their order
/// (MeasurementBuffer).
class Arrivals {
 public:
  using Verdict = ClockGuard::Verdict;

  explicit Arrivals(const MeasurementBuffer::Options& options)
      : options_(options), guard_(options), buffer_(options) {}

  /// Whether the values can be measured ones; those that cannot are counted.
  bool isValid(const Measurement& measurement);
  /// A valid one comes. After kJump what confirmed the jump is held until goOn().
  Verdict add(Measurement measurement);
  /// s from the newest stamp before the jump to the first one behind it; negative: back.
  double jump() const;
  /// Takes in what confirmed the jump.
  void goOn();

  /// The oldest measurement that is due, if any.
  std::optional<Measurement> pop() { return buffer_.pop(); }
  /// The oldest one, due or not.
  std::optional<Measurement> popRegardless() { return buffer_.popRegardless(); }
  /// The oldest sample of the IMU that is held; none: nullptr.
  const ImuSample* nextImu() const { return buffer_.nextImu(); }
  /// The data are over: nothing will confirm a stamp that is far off.
  void close() { guard_.discard(); }
  /// Forgets all that is held; counts stay.
  void clear();

  bool empty() const { return buffer_.empty(); }
  /// Whether more is held than may be.
  bool isOverfull() const { return buffer_.size() > options_.max_size; }
  /// The newest stamp since the last clear; nothing: none has come.
  std::optional<Stamp> newest() const { return buffer_.newest(); }
  /// s of sensor time from the first stamp since the last clear to the newest one.
  std::optional<double> duration() const;
  ArrivalCounts counts() const;

 private:
  void buffer(Measurement measurement);

  MeasurementBuffer::Options options_;
  ClockGuard guard_;
  MeasurementBuffer buffer_;
  std::vector<Measurement> jumped_;
  std::optional<Stamp> first_stamp_;
  ArrivalCounts counts_; ///< but for strays
};

} // namespace vi_ekf_slam

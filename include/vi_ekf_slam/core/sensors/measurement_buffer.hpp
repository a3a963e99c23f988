#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Puts measurements of several streams, each with its own rate and latency, into the order of their stamps.
///
/// A measurement is due when no stream that is still alive can bring an older one: every live stream has
/// delivered up to its stamp. A stream is alive while it lags the newest stamp by at most `max_delay` plus
/// its period, which is the longest of its last `kIntervals` intervals, at most `kMaxPeriodS`, and as long as
/// that before it has sent two.
///
/// What comes out depends on the stamps alone, never on the order in which the streams arrive, and nothing is
/// lost, as long as
/// - each stream keeps its own order: what a stream sends after a newer sample of its own may be late;
/// - no measurement arrives later than `max_delay` after its stamp. Where a stream's intervals vary, what one
///   exceeds the period by counts as delay, and so does what exceeds `kMaxPeriodS`;
/// - the streams begin within `kMaxPeriodS` of each other.
/// A stream that stops delays the others once and by no more than `max_delay` plus its period. When it
/// returns it may lose one sample, which is late but counts as a sign of life.
class MeasurementBuffer {
 public:
  /// s; no stream's next sample is waited for longer than this plus `max_delay`.
  static constexpr double kMaxPeriodS = 1.0;
  /// Of a stream that loses samples at random: the next interval is longer than all of the last 19 in one
  /// case of 20, whatever their distribution.
  static constexpr std::size_t kIntervals = 19;

  struct Options {
    double max_delay_s = 0.2; ///< s of sensor time that a measurement may arrive after its stamp; > 0
    /// s; a stamp that is older or newer than all others by more than this is a jump or wrong (see
    /// ClockGuard)
    double max_jump_s = 1.0;
    double max_gap_s = 30.0; ///< s; after a longer gap the estimate starts anew
    /// Measurements in a row that make a jump (1: any does). Single wrong stamps happen, five are a clock.
    std::size_t jump_confirmations = 5;
    /// Measurements held; beyond it the oldest are released. Bounds the memory: minutes of a fast IMU.
    std::size_t max_size = 100000;
  };

  enum class Verdict {
    kAccepted,
    kLate,      ///< older than what was already handed out: dropped
    kDuplicate, ///< the stream already has a measurement of this stamp: dropped
    kJumpBack,  ///< time went back by more than max_jump_s: nothing was stored, the caller must reset
  };

  explicit MeasurementBuffer(const Options& options) : options_(options) {}

  Verdict add(Measurement measurement);

  /// The oldest measurement that is due, if any.
  std::optional<Measurement> pop();

  /// The oldest measurement, due or not: for the end of the data.
  std::optional<Measurement> popRegardless();

  /// The oldest sample of the IMU that is held; none: nullptr.
  const ImuSample* nextImu() const;

  std::size_t size() const { return pending_.size(); }
  bool empty() const { return pending_.empty(); }
  /// The oldest stamp held; the buffer must not be empty.
  Stamp oldest() const { return pending_.begin()->first.first; }
  /// The newest stamp seen since the last clear; nothing before the first measurement.
  std::optional<Stamp> newest() const { return newest_; }

  void clear();

 private:
  using Key = std::pair<Stamp, Stream>;

  struct StreamClock {
    std::optional<Stamp> reached; ///< the newest stamp of the stream, be it accepted or late
    double period_s = kMaxPeriodS;
    std::deque<double> intervals_s; ///< the last ones, oldest first

    void reach(Stamp stamp);
  };

  Stamp watermark() const;

  Options options_;
  std::map<Key, Measurement> pending_;
  std::array<StreamClock, kStreamCount> clocks_;
  std::optional<Stamp> first_;
  std::optional<Stamp> newest_;
  std::optional<Stamp> last_released_;
};

} // namespace vi_ekf_slam

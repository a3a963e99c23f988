#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/measurement.hpp"

namespace vi_ekf_slam {

/// Puts measurements of several streams, each with its own rate and latency, into the order of their stamps.
///
/// A measurement is due when no stream that is still alive can bring an older one: every live stream has
/// delivered up to its stamp. A stream is alive while it lags the newest stamp by at most `max_delay`, so a
/// stream that stops delays the others once and by no more than that. What comes out depends on the stamps
/// alone, never on the order of arrival, as long as no measurement is later than `max_delay`.
class MeasurementBuffer {
 public:
  struct Options {
    double max_delay_s = 0.2; ///< s of sensor time that a live stream may lag; > 0
    double max_jump_back_s =
        1.0; ///< s; an older stamp by more than this is a new start, by less a late message
    std::size_t max_size = 100000; ///< measurements held; beyond it the oldest are released
  };

  enum class Verdict {
    kAccepted,
    kLate,      ///< older than what was already handed out: dropped
    kDuplicate, ///< the stream already has a measurement of this stamp: dropped
    kJumpBack,  ///< time went back by more than max_jump_back: nothing was stored, the caller must reset
  };

  explicit MeasurementBuffer(const Options& options);

  Verdict add(Measurement measurement);

  /// The oldest measurement that is due, if any.
  std::optional<Measurement> pop();

  /// The oldest measurement, due or not: for the end of the data.
  std::optional<Measurement> popRegardless();

  std::size_t size() const { return pending_.size(); }
  bool empty() const { return pending_.empty(); }
  /// The oldest stamp held; the buffer must not be empty.
  Stamp oldest() const { return pending_.begin()->first.first; }
  /// The newest stamp seen since the last clear; nothing before the first measurement.
  std::optional<Stamp> newest() const { return newest_; }

  void clear();

 private:
  using Key = std::pair<Stamp, Stream>;

  Stamp watermark() const;

  Options options_;
  std::map<Key, Measurement> pending_;
  std::array<std::optional<Stamp>, kStreamCount> newest_of_stream_;
  std::optional<Stamp> first_;
  std::optional<Stamp> newest_;
  std::optional<Stamp> last_released_;
};

} // namespace vi_ekf_slam

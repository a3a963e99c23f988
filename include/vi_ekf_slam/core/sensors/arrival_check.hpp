#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Looks whether the streams are stamped by one clock: what comes much later after its stamp than another
/// stream does is late, or has another clock. Judged over the first seconds, and whenever two stretches as
/// long say the same later; check_rig.py says it of a recording. The least delay counts, since queues only
/// add. A stretch in which the stamps of a stream go back begins anew.
class ArrivalCheck {
 public:
  /// `limit`, s: that the buffer waits for what is late.
  explicit ArrivalCheck(double limit) : limit_(limit) {}

  /// A message of this stamp has been received at `received`, in the clock of the machine. Returns what is
  /// wrong, once, when it is found; else empty.
  std::string note(Stream stream, Stamp stamp, Stamp received);

 private:
  struct Delay {
    std::size_t count = 0;
    double least = 0.0; ///< s
  };

  double limit_;
  std::array<Delay, kStreamCount> delays_;
  std::array<std::optional<Stamp>, kStreamCount> stamps_; ///< the last ones
  std::optional<Stamp> begin_;
  bool told_ = false;
  std::size_t suspected_ = 1; ///< stretches in a row; one stands for the start, when nobody pauses anything
};

} // namespace vi_ekf_slam

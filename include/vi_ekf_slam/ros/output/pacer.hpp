#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Bounds the bandwidth of a topic whose messages grow: the next one leaves `period_s` after the last, and
/// not before the last one's size has been paid off at `bytes_per_s`. By sensor time.
class Pacer {
 public:
  Pacer(double period_s, double bytes_per_s) : period_s_(period_s), bytes_per_s_(bytes_per_s) {}

  bool isDue(Stamp stamp) const { return !last_ || secondsBetween(*last_, stamp) >= wait_s_; }
  void noteSent(Stamp stamp, std::size_t bytes) {
    last_ = stamp;
    last_bytes_ = bytes;
    wait_s_ = std::max(period_s_, static_cast<double>(bytes) / bytes_per_s_);
  }
  /// s from the last one to the next at least.
  double wait() const { return last_ ? wait_s_ : 0.0; }
  void restart() { last_.reset(); }
  /// From now on, and for what was sent last.
  void setRate(double period_s, double bytes_per_s) {
    period_s_ = period_s;
    bytes_per_s_ = bytes_per_s;
    if (last_) wait_s_ = std::max(period_s_, static_cast<double>(last_bytes_) / bytes_per_s_);
  }

 private:
  double period_s_;
  double bytes_per_s_;
  std::optional<Stamp> last_;
  std::size_t last_bytes_ = 0;
  double wait_s_ = 0.0;
};

} // namespace vi_ekf_slam

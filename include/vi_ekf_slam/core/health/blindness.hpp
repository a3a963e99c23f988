#pragma once

#include <cstdint>
#include <optional>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// For how long no feature has corrected the estimate: then it is dead reckoning, whose covariance grows.
class Blindness {
 public:
  static constexpr double kPatience = 1.0; ///< s without a correction that are nothing special

  /// Any measurement was processed, in the order of stamps.
  void advanceTo(Stamp stamp) {
    if (!last_use_) last_use_ = stamp;
    if (!isBlind() && secondsBetween(*last_use_, stamp) > kPatience) ++periods_;
    now_ = stamp;
  }
  /// Features corrected the estimate at the last stamp.
  void noteUse() {
    if (isBlind()) total_s_ += current();
    last_use_ = now_;
  }
  /// The clock starts anew.
  void restart() {
    noteUse();
    last_use_.reset();
  }

  bool isBlind() const { return last_use_ && current() > kPatience; }
  /// s since the last correction.
  double current() const { return last_use_ ? secondsBetween(*last_use_, now_) : 0.0; }
  /// s within the periods longer than kPatience, the present one included.
  double total() const { return total_s_ + (isBlind() ? current() : 0.0); }
  std::uint64_t periods() const { return periods_; }

 private:
  Stamp now_ = 0;
  std::optional<Stamp> last_use_;
  double total_s_ = 0.0;
  std::uint64_t periods_ = 0;
};

} // namespace vi_ekf_slam

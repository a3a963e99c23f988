#pragma once

#include <cstddef>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Whether an IMU's samples come fast enough for their accelerations to be integrated: at kLeast or more. A
/// vehicle shakes at up to some 25 Hz (wheel hop is at 10 to 15 Hz), which slower samples take for a motion.
class ImuRate {
 public:
  /// The next sample as it comes; nothing as long as too few have come. One interval that is short enough
  /// says so, since a sample can be lost, and several that are not say the contrary.
  std::optional<bool> suffices(Stamp stamp) {
    const std::optional<Stamp> before = std::exchange(last_, stamp);
    if (!before || stamp <= *before) return {};
    if (secondsBetween(*before, stamp) <= kRoom / kLeast) return true;
    if (++long_intervals_ >= kLongIntervals) return false;
    return {};
  }
  bool hasSamples() const { return last_.has_value(); }

 private:
  static constexpr double kLeast = 50.0;           // Hz
  static constexpr double kRoom = 1.1;             // of the interval: stamps jitter
  static constexpr std::size_t kLongIntervals = 4; // at the start, that are no loss of samples any more

  std::optional<Stamp> last_;
  std::size_t long_intervals_ = 0;
};

} // namespace vi_ekf_slam

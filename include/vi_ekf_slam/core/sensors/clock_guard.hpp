#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement_buffer.hpp"

namespace vi_ekf_slam {

/// Tells a clock that jumped (a gap, a bag that loops, a new simulation) from a stamp that is wrong by itself
/// (a corrupt message, a sensor with another clock).
///
/// A stamp that is far ahead of all others, or far behind, is not believed at once: the measurement is held.
/// `jump_confirmations` such measurements in a row, near each other, are a jump, and none of them is lost. A
/// measurement that goes on where the others were refutes it: what was held is stray.
///
/// A stream that was held up, as by its connection, and goes on where it was, is late: no clock has jumped.
///
/// The state moves by the gyro's clock. So the first gyro sample is believed at once, whatever came before it
/// from a sensor with another clock.
class ClockGuard {
 public:
  enum class Verdict {
    kPass, ///< near the others
    kHeld, ///< waits for its confirmation
    kJump, ///< the clock has jumped: take() has all measurements since then
  };

  /// Stray measurements of each stream.
  struct Strays {
    std::array<std::uint64_t, kStreamCount> ahead{};
    std::array<std::uint64_t, kStreamCount> behind{};
  };

  explicit ClockGuard(const MeasurementBuffer::Options& options) : options_(options) {}

  /// `newest`: the newest stamp that was believed, if any. Held measurements are moved from.
  Verdict judge(Measurement& measurement, std::optional<Stamp> newest);

  /// What confirmed a jump, in the order of arrival.
  std::vector<Measurement> take();

  /// Nothing more will confirm what is held: it is stray.
  void discard();

  const Strays& strays() const { return strays_; }

 private:
  enum class Side { kNear, kAhead, kBehind };
  Side sideOf(Stamp stamp, Stamp newest) const;

  MeasurementBuffer::Options options_;
  std::vector<Measurement> held_;
  Side held_side_ = Side::kNear;
  bool gyro_believed_ = false; ///< since nothing was believed
  std::array<std::optional<Stamp>, kStreamCount> last_; ///< of each stream that was believed
  Strays strays_;
};

} // namespace vi_ekf_slam

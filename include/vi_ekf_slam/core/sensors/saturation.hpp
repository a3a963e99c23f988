#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

namespace vi_ekf_slam {

/// Looks whether one axis of a sensor ends where its range does: its largest value is cut off, so that it
/// comes again and again, for some samples in a row and with a leap to it. Neither noise nor a motion within
/// the range does that, nor an axis whose values repeat wherever they are.
class Saturation {
 public:
  /// Whether it is found by now; `value` is the next one.
  bool note(double value) {
    const double step = last_ ? std::abs(value - *last_) : 0.0;
    if (step > 0.0) quantum_ = std::min(quantum_, step);
    last_ = value;
    ends_[0].note(value, step, quantum_);
    ends_[1].note(-value, step, quantum_);
    return ends_[0].isCutOff() || ends_[1].isCutOff();
  }
  /// Without its sign.
  double limit() const { return ends_[ends_[0].isCutOff() ? 0 : 1].value; }

 private:
  static constexpr std::size_t kInARow = 3, kTimes = 3, kFewest = 100;
  // Noise at rest and the top of a slow motion reach the largest value by a quantum or two.
  static constexpr double kLeap = 4.0;
  // Of the values within the range one in so many is as the one before, at most: of noise of one quantum 28
  // in 100 are, where a driver sends every sample twice 50.
  static constexpr std::size_t kRepeats = 3;
  static constexpr double kWithin = 0.99; // of the largest: the two ends differ by a quantum

  struct End {
    double value = 0.0; ///< the largest so far
    double leap = 0.0;  ///< by which it was reached last
    std::size_t in_a_row = 0, times = 0;
    std::size_t within = 0, repeated = 0; ///< values well within the range, and those as the one before

    void note(double x, double step, double quantum) {
      if (x > value) {
        value = x;
        in_a_row = times = 0;
      }
      if (x > 0.0 && x == value) {
        if (in_a_row++ == 0) leap = step;
        if (in_a_row == kInARow && leap > kLeap * quantum) ++times;
        return;
      }
      in_a_row = 0;
      if (std::abs(x) >= kWithin * value) return;
      ++within;
      if (step == 0.0) ++repeated;
    }
    bool isCutOff() const { return times >= kTimes && within >= kFewest && kRepeats * repeated <= within; }
  };

  std::array<End, 2> ends_;                                  ///< of positive values, of negative ones
  double quantum_ = std::numeric_limits<double>::infinity(); ///< the least step
  std::optional<double> last_;
};

} // namespace vi_ekf_slam

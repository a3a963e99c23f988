#pragma once

#include <optional>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Sees to it that little is deferred when a loop is closed: then landmarks become active within some
/// milliseconds. What is more is settled by a thread beside the frames (InactiveStore::beginSettling), for
/// which the loop waits, and not the frames. When that begins and ends is told by stamps and counts, so that
/// the result does not depend on timing.
class Settling {
 public:
  /// How much the thread may do in a second, floating-point operations on the average: a fifth of a core with
  /// AVX2.
  explicit Settling(double operations_per_second = 5e9) : per_second_(operations_per_second) {}

  /// After a frame of stamp `now`.
  void advance(Filter& filter, Stamp now) {
    if (!ends_ || now < *ends_) return;
    filter.endSettlingInactive();
    ends_.reset();
  }
  /// Whether a loop may be closed now. Where not, it soon may.
  bool isReady(Filter& filter, Stamp now) {
    const bool is_ready = filter.inactive().deferredBlocks() <= kFewBlocks;
    if (!is_ready) begin(filter, now);
    return is_ready;
  }

 private:
  void begin(Filter& filter, Stamp now) {
    if (ends_) return;
    const double cost = filter.inactive().settlingCost();
    if (last_ && secondsBetween(*last_, now) * per_second_ < cost) return;
    filter.beginSettlingInactive();
    last_ = now;
    ends_ = now + fromSeconds(cost / kSpeed);
  }

  static constexpr std::size_t kFewBlocks = 6;
  /// Floating-point operations in a second that a core manages: 2.2e10 to 3.6e10 were measured with AVX2. A
  /// frame waits where it does not.
  static constexpr double kSpeed = 1e10;

  double per_second_;
  std::optional<Stamp> last_, ends_; ///< when it began last; when it ends, if it is under way
};

} // namespace vi_ekf_slam

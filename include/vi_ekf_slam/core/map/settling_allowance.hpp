#pragma once

#include <algorithm>

namespace vi_ekf_slam {

/// Work for settling the inactive variables (InactiveStore::settle), earned with the time that passes: on the
/// average closures cost no more than their share of a core, whatever the size of the map.
class SettlingAllowance {
 public:
  /// Floating-point operations.
  explicit SettlingAllowance(double per_second) : per_second_(per_second) {}

  /// `seconds` have passed since the last frame; settling would cost `cost` now. As much is saved as two
  /// settlings have cost at the most: what is in view changes the cost from frame to frame, and on a long way
  /// without loops it grows faster than what is earned.
  void earn(double seconds, double cost) {
    cost_ = cost;
    greatest_cost_ = std::max(greatest_cost_, cost);
    saved_ =
        std::min(saved_ + seconds * per_second_, std::max(2.0 * greatest_cost_, kMostSaved * per_second_));
  }
  /// For settling in this frame.
  bool suffices() const { return saved_ >= cost_; }
  void spend() { saved_ -= cost_; }

 private:
  static constexpr double kMostSaved = 10.0; ///< s of work

  double per_second_;
  double saved_ = 0.0, cost_ = 0.0, greatest_cost_ = 0.0;
};

} // namespace vi_ekf_slam

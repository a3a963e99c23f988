#pragma once

#include <algorithm>
#include <cstddef>

namespace vi_ekf_slam {

/// How many features a frame may have: fewer while the node lags, since the time for an update, and for
/// each IMU sample too, grows with the landmarks of the state.
class LoadControl {
 public:
  static constexpr std::size_t kMinFeatures = 30;

  /// `max_latency_s`: 0 never limits.
  LoadControl(std::size_t max_features, double max_latency_s)
      : max_(max_features), max_latency_s_(max_latency_s), limit_(max_features) {}

  /// Takes note of a frame that has waited for `age_s` (s of wall time).
  void noteFrame(double age_s) {
    if (max_latency_s_ <= 0.0) return;
    if (age_s > max_latency_s_) {
      limit_ = std::min(limit_, std::max(kMinFeatures, limit_ / 2));
    } else if (age_s > 0.25 * max_latency_s_) {
      limit_ = std::min(limit_, std::max(kMinFeatures, limit_ * 4 / 5));
    } else if (age_s < 0.05 * max_latency_s_) {
      limit_ = std::min(max_, limit_ + 1 + limit_ / 100);
    }
  }

  std::size_t limit() const { return limit_; }

 private:
  std::size_t max_;
  double max_latency_s_;
  std::size_t limit_;
};

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/sensors/imu_rate.hpp"

#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kLongIntervals = 4; // in a row, at the start, that are no loss of samples any more
constexpr double kRoom = 1.1;             // of the interval: stamps jitter

} // namespace

std::optional<bool> ImuRate::suffices(Stamp stamp) {
  const std::optional<Stamp> before = std::exchange(last_, stamp);
  if (!before || stamp <= *before) return {};
  if (secondsBetween(*before, stamp) <= kRoom / kLeast) return true;
  if (++long_intervals_ >= kLongIntervals) return false;
  return {};
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/sensors/clock_guard.hpp"

#include <cmath>
#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr double kTogether = 10.0; // s; measurements farther apart do not confirm each other

} // namespace

ClockGuard::Side ClockGuard::sideOf(Stamp stamp, Stamp newest) const {
  const double ahead = secondsBetween(newest, stamp);
  if (ahead > options_.max_jump_s) return Side::kAhead;
  return -ahead > options_.max_jump_s ? Side::kBehind : Side::kNear;
}

ClockGuard::Verdict ClockGuard::judge(Measurement& measurement, std::optional<Stamp> newest) {
  const Stamp stamp = stampOf(measurement);
  const Side side = newest ? sideOf(stamp, *newest) : Side::kNear;
  const bool agrees = side == held_side_ && !held_.empty() &&
                      std::abs(secondsBetween(stampOf(held_.back()), stamp)) <= kTogether;
  // A sensor whose clock stands still says the same again and again, which confirms nothing.
  const bool repeats =
      agrees && stampOf(held_.back()) == stamp && streamOf(held_.back()) == streamOf(measurement);
  if (!agrees || repeats) discard();
  if (!newest) {
    gyro_believed_ = false;
    last_ = {};
  }
  const bool first_gyro = streamOf(measurement) == Stream::kImu && !gyro_believed_;
  if (first_gyro) gyro_believed_ = true;
  std::optional<Stamp>& last = last_[static_cast<std::size_t>(streamOf(measurement))];
  const bool was_held_up = side == Side::kBehind && last && stamp > *last;
  if (side == Side::kNear || was_held_up) {
    last = stamp;
    return Verdict::kPass;
  }
  held_side_ = side;
  held_.push_back(std::move(measurement));
  return first_gyro || held_.size() >= options_.jump_confirmations ? Verdict::kJump : Verdict::kHeld;
}

std::vector<Measurement> ClockGuard::take() {
  last_ = {};
  for (const Measurement& m : held_) last_[static_cast<std::size_t>(streamOf(m))] = stampOf(m);
  return std::exchange(held_, {});
}

void ClockGuard::discard() {
  auto& counts = held_side_ == Side::kAhead ? strays_.ahead : strays_.behind;
  for (const Measurement& m : held_) ++counts[static_cast<std::size_t>(streamOf(m))];
  held_.clear();
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/sensors/measurement_buffer.hpp"

#include <algorithm>

namespace vi_ekf_slam {

MeasurementBuffer::Verdict MeasurementBuffer::add(Measurement measurement) {
  const Stamp stamp = stampOf(measurement);
  const Stream stream = streamOf(measurement);
  if (newest_ && secondsBetween(stamp, *newest_) > options_.max_jump_s) return Verdict::kJumpBack;
  StreamClock& clock = clocks_[static_cast<std::size_t>(stream)];
  if (last_released_ && stamp < *last_released_) {
    clock.reach(stamp);
    return Verdict::kLate;
  }
  const bool handed_out = last_released_ == stamp && clock.reached && *clock.reached >= stamp;
  if (handed_out || !pending_.try_emplace({stamp, stream}, std::move(measurement)).second) {
    return Verdict::kDuplicate;
  }
  clock.reach(stamp);
  newest_ = std::max(newest_.value_or(stamp), stamp);
  first_ = std::min(first_.value_or(stamp), stamp);
  return Verdict::kAccepted;
}

void MeasurementBuffer::StreamClock::reach(Stamp stamp) {
  if (reached && stamp <= *reached) return;
  if (reached) {
    intervals_s.push_back(secondsBetween(*reached, stamp));
    if (intervals_s.size() > kIntervals) intervals_s.pop_front();
    period_s = std::min(*std::max_element(intervals_s.begin(), intervals_s.end()), kMaxPeriodS);
  }
  reached = stamp;
}

Stamp MeasurementBuffer::watermark() const {
  Stamp mark = *newest_;
  for (const StreamClock& clock : clocks_) {
    // A stream that never spoke is waited for as if it had spoken just before the first measurement.
    const Stamp reached = clock.reached.value_or(*first_ - 1);
    if (secondsBetween(reached, *newest_) <= options_.max_delay_s + clock.period_s) {
      mark = std::min(mark, reached);
    }
  }
  return mark;
}

std::optional<Measurement> MeasurementBuffer::pop() {
  if (pending_.empty()) return std::nullopt;
  if (pending_.size() <= options_.max_size && oldest() > watermark()) return std::nullopt;
  return popRegardless();
}

std::optional<Measurement> MeasurementBuffer::popRegardless() {
  if (pending_.empty()) return std::nullopt;
  auto node = pending_.extract(pending_.begin());
  last_released_ = node.key().first;
  return std::move(node.mapped());
}

const ImuSample* MeasurementBuffer::nextImu() const {
  for (const auto& [key, measurement] : pending_) {
    if (const auto* sample = std::get_if<ImuSample>(&measurement)) return sample;
  }
  return nullptr;
}

void MeasurementBuffer::clear() {
  pending_.clear();
  clocks_.fill({});
  newest_.reset();
  first_.reset();
  last_released_.reset();
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/measurement_buffer.hpp"

#include <algorithm>

namespace vi_ekf_slam {

MeasurementBuffer::MeasurementBuffer(const Options& options) : options_(options) {}

MeasurementBuffer::Verdict MeasurementBuffer::add(Measurement measurement) {
  const Stamp stamp = stampOf(measurement);
  const Stream stream = streamOf(measurement);
  if (newest_ && secondsBetween(stamp, *newest_) > options_.max_jump_back_s) return Verdict::kJumpBack;
  auto& newest_of_stream = newest_of_stream_[static_cast<std::size_t>(stream)];
  if (last_released_ && stamp < *last_released_) return Verdict::kLate;
  const bool handed_out = last_released_ == stamp && newest_of_stream && *newest_of_stream >= stamp;
  if (handed_out || !pending_.try_emplace({stamp, stream}, std::move(measurement)).second) {
    return Verdict::kDuplicate;
  }
  newest_of_stream = std::max(newest_of_stream.value_or(stamp), stamp);
  newest_ = std::max(newest_.value_or(stamp), stamp);
  first_ = std::min(first_.value_or(stamp), stamp);
  return Verdict::kAccepted;
}

Stamp MeasurementBuffer::watermark() const {
  Stamp mark = *newest_;
  for (const auto& newest_of_stream : newest_of_stream_) {
    // A stream that never spoke is waited for as if it had spoken just before the first measurement.
    const Stamp reached = newest_of_stream.value_or(*first_ - 1);
    if (secondsBetween(reached, *newest_) <= options_.max_delay_s) mark = std::min(mark, reached);
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

void MeasurementBuffer::clear() {
  pending_.clear();
  newest_of_stream_.fill(std::nullopt);
  newest_.reset();
  first_.reset();
  last_released_.reset();
}

} // namespace vi_ekf_slam

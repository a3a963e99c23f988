#include "vi_ekf_slam/ros/node/latency_meter.hpp"

#include <algorithm>

namespace vi_ekf_slam {

void LatencyMeter::noteArrival(Stream stream, Stamp stamp, WorkQueue::Clock::time_point arrival) {
  auto& waiting = waiting_[static_cast<std::size_t>(stream)];
  waiting.try_emplace(stamp, arrival);
  if (waiting.size() > kMaxWaiting) waiting.erase(waiting.begin());
}

void LatencyMeter::noteResult(Stream stream, Stamp stamp, WorkQueue::Clock::time_point now) {
  auto& waiting = waiting_[static_cast<std::size_t>(stream)];
  const auto found = waiting.find(stamp);
  if (found == waiting.end()) return;
  if (latencies_.size() < kMaxWaiting)
    latencies_.push_back(std::chrono::duration<double>(now - found->second).count());
  waiting.erase(waiting.begin(), std::next(found));
}

void LatencyMeter::restart() { waiting_.fill({}); }

LatencyMeter::Summary LatencyMeter::take() {
  Summary summary;
  std::sort(latencies_.begin(), latencies_.end());
  summary.results = latencies_.size();
  if (!latencies_.empty()) {
    summary.median_s = latencies_[latencies_.size() / 2];
    summary.p95_s = latencies_[latencies_.size() * 95 / 100];
    summary.max_s = latencies_.back();
  }
  latencies_.clear();
  return summary;
}

} // namespace vi_ekf_slam

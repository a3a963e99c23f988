#pragma once

#include <array>
#include <map>
#include <vector>

#include "vi_ekf_slam/ros/node/work_queue.hpp"

namespace vi_ekf_slam {

/// Wall time from a measurement's arrival in its callback to the publication of its result.
class LatencyMeter {
 public:
  struct Summary {
    std::size_t results = 0;
    double median_s = 0.0, p95_s = 0.0, max_s = 0.0;
  };

  void noteArrival(Stream stream, Stamp stamp, WorkQueue::Clock::time_point arrival);
  void noteResult(Stream stream, Stamp stamp, WorkQueue::Clock::time_point now = WorkQueue::Clock::now());
  /// Time went back or began anew.
  void restart();
  /// Since the last call.
  Summary take();

 private:
  static constexpr std::size_t kMaxWaiting = 10000; // measurements a stream

  std::array<std::map<Stamp, WorkQueue::Clock::time_point>, kStreamCount> waiting_;
  std::vector<double> latencies_;
};

} // namespace vi_ekf_slam

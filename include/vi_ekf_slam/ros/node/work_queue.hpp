#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

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

/// Between the callbacks, which only put their message here, and the thread that computes. Thread-safe.
///
/// When the computing does not keep up, frames are shed, the oldest first: one that has waited for more than
/// `max_latency_s`, while a newer one is here. One in each `max_latency_s` is given out all the same, since
/// with none at all the filter could not let go of its landmarks. Before it comes to that, fewer features of
/// each are to be taken (LoadControl). IMU and velocity are never shed. Only when `max_size` is reached,
/// which bounds the memory, the oldest frame or, without one, the oldest item is dropped.
class WorkQueue {
 public:
  using Clock = std::chrono::steady_clock;

  struct Options {
    double max_latency_s = 0.0; ///< s of wall time; 0: nothing is shed
    std::size_t max_size = 100000;
    std::size_t max_features = 400; ///< of a frame
    std::function<Clock::time_point()> now = Clock::now;
  };

  struct Item {
    std::function<void()> work;
    std::optional<Stream> stream; ///< nothing: neither counted nor dropped
    Clock::time_point arrival;
  };

  struct Counts {
    std::uint64_t frames_shed = 0;                      ///< too old while a newer one was here
    std::array<std::uint64_t, kStreamCount> overflow{}; ///< dropped because the queue was full
    std::size_t size = 0;                               ///< items that wait now
  };

  explicit WorkQueue(const Options& options)
      : options_(options), load_(options.max_features, options.max_latency_s) {}

  /// False, and nothing is done, once the queue is closed.
  bool push(std::function<void()> work, std::optional<Stream> stream);
  /// The next item; nothing after `wait_s` without one.
  std::optional<Item> pop(double wait_s);
  /// Nothing more comes in; what is held can still be taken.
  void close();
  /// Drops what is held; returns how many measurements that were.
  std::size_t clear();
  bool closed() const;
  Counts counts() const;
  /// Features that are to be taken of a frame at most, as the load is.
  std::size_t featureLimit() const;

 private:
  static bool isFrame(const Item& item) { return item.stream == Stream::kStereo; }
  /// s since `then`.
  double age(Clock::time_point then) const {
    return std::chrono::duration<double>(options_.now() - then).count();
  }
  void makeRoom();
  void shedOld();

  Options options_;
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Item> items_;
  std::size_t frames_ = 0;                      ///< among the items
  std::optional<Clock::time_point> last_frame_; ///< when one was given out
  LoadControl load_;
  Counts counts_;
  bool closed_ = false;
};

/// Seconds since `then`.
inline double secondsSince(WorkQueue::Clock::time_point then) {
  return std::chrono::duration<double>(WorkQueue::Clock::now() - then).count();
}

} // namespace vi_ekf_slam

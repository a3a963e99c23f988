#pragma once

#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "vi_ekf_slam/ros/node/work_queue.hpp"

namespace vi_ekf_slam {

/// The thread that computes, and the queue that feeds it. What throws in it ends it, not the process.
class Worker {
 public:
  struct Duties {
    std::function<void(WorkQueue::Item&)> process;
    /// After each item, and each wait in vain; `is_pause`: nothing has come for a while.
    std::function<void(bool is_pause)> tend;
    /// In the worker's thread, its last act, with what was thrown.
    std::function<void(const std::string&)> fail;
  };

  explicit Worker(const WorkQueue::Options& options) : queue_(options) {}
  ~Worker() { stop(); }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  WorkQueue& queue() { return queue_; }
  const WorkQueue& queue() const { return queue_; }
  void start(Duties duties);
  /// Hands `task` to the worker and waits for it; what it throws comes out here. False: the worker has ended.
  bool run(const std::function<void()>& task);
  /// Takes nothing more, and ends when what is held is done, after a few s at most. A second call does
  /// nothing.
  void stop();
  /// What ended the computing early; empty: nothing.
  std::string failure() const;

 private:
  void work();

  Duties duties_;
  WorkQueue queue_;
  std::atomic<bool> abandon_{false};
  mutable std::mutex failure_mutex_;
  std::string failure_;
  std::thread thread_;
};

} // namespace vi_ekf_slam

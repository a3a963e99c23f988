#include "vi_ekf_slam/ros/node/worker.hpp"

#include <ros/console.h>

#include <chrono>
#include <exception>
#include <future>
#include <memory>
#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr double kIdlePeriod = 0.05; // s that the worker waits for a message
constexpr int kPause = 4;            // such waits in vain
constexpr double kDrainLimit = 8.0;  // s; roslaunch waits 15 s between SIGINT and SIGTERM

} // namespace

void Worker::start(Duties duties) {
  duties_ = std::move(duties);
  thread_ = std::thread(&Worker::work, this);
}

void Worker::work() {
  try {
    int idle = 0;
    while (!abandon_) {
      auto item = queue_.pop(kIdlePeriod);
      idle = item ? 0 : idle + 1;
      if (item) duties_.process(*item);
      if (!item && queue_.closed()) return;
      duties_.tend(idle >= kPause);
    }
  } catch (const std::exception& e) {
    const std::string failure = std::string("the computing has ended: ") + e.what();
    ROS_FATAL_STREAM(failure);
    queue_.close();
    queue_.clear();
    {
      const std::lock_guard<std::mutex> lock(failure_mutex_);
      failure_ = failure;
    }
    duties_.fail(failure);
  }
}

bool Worker::run(const std::function<void()>& task) {
  const auto packaged = std::make_shared<std::packaged_task<void()>>(task);
  std::future<void> done = packaged->get_future();
  if (!queue_.push([packaged] { (*packaged)(); }, {})) return false;
  try {
    done.get();
  } catch (const std::future_error&) {
    return false; // the node ends, and the task was thrown away
  }
  return true;
}

void Worker::stop() {
  queue_.close();
  const auto start = WorkQueue::Clock::now();
  while (queue_.counts().size > 0 && secondsSince(start) < kDrainLimit) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const std::size_t lost = queue_.clear();
  if (lost > 0) ROS_WARN_STREAM("stopped before " << lost << " messages that had come were processed");
  abandon_ = true;
  if (thread_.joinable()) thread_.join();
}

std::string Worker::failure() const {
  const std::lock_guard<std::mutex> lock(failure_mutex_);
  return failure_;
}

} // namespace vi_ekf_slam

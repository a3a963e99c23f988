#include "vi_ekf_slam/ros/node/work_queue.hpp"

#include <algorithm>
#include <utility>

namespace vi_ekf_slam {

bool WorkQueue::push(std::function<void()> work, std::optional<Stream> stream) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (closed_) return false;
    if (items_.size() >= options_.max_size) makeRoom();
    items_.push_back({std::move(work), stream, options_.now()});
    if (isFrame(items_.back())) ++frames_;
  }
  arrived_.notify_one();
  return true;
}

void WorkQueue::makeRoom() {
  auto victim = std::find_if(items_.begin(), items_.end(), isFrame);
  if (victim == items_.end()) {
    victim =
        std::find_if(items_.begin(), items_.end(), [](const Item& item) { return item.stream.has_value(); });
  }
  if (victim == items_.end()) return;
  if (isFrame(*victim)) --frames_;
  ++counts_.overflow[static_cast<std::size_t>(*victim->stream)];
  items_.erase(victim);
}

void WorkQueue::shedOld() {
  while (options_.max_latency_s > 0.0 && frames_ > 1 && isFrame(items_.front()) &&
         age(items_.front().arrival) > options_.max_latency_s && last_frame_ &&
         age(*last_frame_) < options_.max_latency_s) {
    items_.pop_front();
    --frames_;
    ++counts_.frames_shed;
  }
}

std::optional<WorkQueue::Item> WorkQueue::pop(double wait_s) {
  std::unique_lock<std::mutex> lock(mutex_);
  arrived_.wait_for(lock, std::chrono::duration<double>(wait_s),
                    [this] { return !items_.empty() || closed_; });
  if (items_.empty()) return std::nullopt;
  shedOld();
  Item item = std::move(items_.front());
  items_.pop_front();
  if (isFrame(item)) {
    --frames_;
    last_frame_ = options_.now();
    load_.noteFrame(age(item.arrival));
  }
  return item;
}

void WorkQueue::close() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    closed_ = true;
  }
  arrived_.notify_all();
}

std::size_t WorkQueue::clear() {
  std::deque<Item> dropped; // destroyed without the lock: somebody may wait for what it held
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    dropped.swap(items_);
    frames_ = 0;
  }
  return static_cast<std::size_t>(std::count_if(dropped.begin(), dropped.end(),
                                                [](const Item& item) { return item.stream.has_value(); }));
}

bool WorkQueue::closed() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return closed_;
}

WorkQueue::Counts WorkQueue::counts() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  Counts counts = counts_;
  counts.size = items_.size();
  return counts;
}

std::size_t WorkQueue::featureLimit() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return load_.limit();
}

} // namespace vi_ekf_slam

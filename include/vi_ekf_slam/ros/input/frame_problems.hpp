#pragma once

#include <cstddef>
#include <functional>
#include <set>
#include <string>
#include <utility>

namespace vi_ekf_slam {

/// Says of each frame (with its input) once why it cannot be used, and what to do.
class FrameProblems {
 public:
  void onProblem(std::function<void(const std::string&)> handler) { handler_ = std::move(handler); }

  void report(const std::string& frame, const std::string& problem) {
    if (reported_.size() < kMost && reported_.insert(frame).second && handler_) handler_(problem);
  }

 private:
  static constexpr std::size_t kMost = 20; // what writes another name each time is not to fill the memory

  std::set<std::string> reported_;
  std::function<void(const std::string&)> handler_;
};

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/health/divergence_monitor.hpp"

#include <algorithm>
#include <numeric>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kFewestMatched = 10; // features; a frame with fewer says nothing
constexpr std::size_t kFewestFrames = 10;
constexpr double kCovered = 0.75;    // of the window, from the oldest frame to the newest
constexpr double kUsedAtLeast = 0.2; // of the matched features, or the frame contradicts the estimate

bool isRefused(const DivergenceMonitor::Frame& frame) {
  return frame.rejected ||
         static_cast<double>(frame.used) < kUsedAtLeast * static_cast<double>(frame.matched);
}

} // namespace

Divergence DivergenceMonitor::add(const Frame& frame) {
  if (!(options_.window_s > 0.0) || frame.matched < kFewestMatched) return Divergence::kNone;
  frames_.push_back(frame);
  while (secondsBetween(frames_.front().stamp, frame.stamp) > options_.window_s) frames_.pop_front();
  if (frames_.size() < kFewestFrames ||
      secondsBetween(frames_.front().stamp, frame.stamp) < kCovered * options_.window_s) {
    return Divergence::kNone;
  }
  const auto refused = std::count_if(frames_.begin(), frames_.end(), isRefused);
  if (static_cast<double>(refused) >= options_.refused_share * static_cast<double>(frames_.size())) {
    return Divergence::kRejections;
  }
  double nis = 0.0, dof = 0.0;
  for (const Frame& f : frames_) {
    nis += f.nis;
    dof += static_cast<double>(f.nis_dof);
  }
  return nis > options_.nis * dof ? Divergence::kInnovations : Divergence::kNone;
}

double DivergenceMonitor::distance() const {
  return std::accumulate(frames_.begin(), frames_.end(), 0.0,
                         [](double sum, const Frame& frame) { return sum + frame.distance; });
}

double DivergenceMonitor::angle() const {
  return std::accumulate(frames_.begin(), frames_.end(), 0.0,
                         [](double sum, const Frame& frame) { return sum + frame.angle; });
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/health/divergence_monitor.hpp"

#include <algorithm>
#include <numeric>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kFewestMatched = 10; // features; a frame with fewer says nothing
constexpr double kCovered = 0.75;          // of the window, for which frames must speak
constexpr double kLongest = 1.0 / 3.0;     // of the window, for which one frame may speak
constexpr double kUsedAtLeast = 0.2;       // of the matched features, or the frame contradicts the estimate

bool isRefused(const DivergenceMonitor::Frame& frame) {
  return frame.rejected ||
         static_cast<double>(frame.used) < kUsedAtLeast * static_cast<double>(frame.matched);
}

} // namespace

Divergence DivergenceMonitor::add(const Frame& frame) {
  if (!(options_.window_s > 0.0) || frame.matched < kFewestMatched) return Divergence::kNone;
  const double since = frames_.empty() ? 0.0 : secondsBetween(frames_.back().frame.stamp, frame.stamp);
  frames_.push_back({frame, std::min(since, kLongest * options_.window_s)});
  while (secondsBetween(frames_.front().frame.stamp, frame.stamp) > options_.window_s) frames_.pop_front();
  double all = 0.0, refused = 0.0, nis = 0.0, dof = 0.0;
  for (const auto& [f, seconds] : frames_) {
    all += seconds;
    if (isRefused(f)) refused += seconds;
    nis += f.nis;
    dof += static_cast<double>(f.nis_dof);
  }
  if (all < kCovered * options_.window_s) return Divergence::kNone;
  if (refused >= options_.refused_share * all) return Divergence::kRejections;
  return nis > options_.nis * dof ? Divergence::kInnovations : Divergence::kNone;
}

double DivergenceMonitor::sumOf(double Frame::*number) const {
  return std::accumulate(frames_.begin(), frames_.end(), 0.0,
                         [=](double sum, const Heard& heard) { return sum + heard.frame.*number; });
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/sensors/track_id_check.hpp"

#include <iterator>
#include <utility>

#include "vi_ekf_slam/core/sensors/median.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

// A rig at rest has ids that seem to follow points, and may begin to move later.
constexpr std::size_t kWindows = 10, kWindowFrames = 10, kWindowPoints = 200;
constexpr double kFollowedShare = 0.1; // of the points; tracks that end after a frame tell nothing
// Of the way to some other point of the frame before, without the way that all have in common. Tracks of nine
// recorded and simulated drives move by at most 0.18 of it in any ten frames, ids that count the points of
// each frame by 0.6 to 1 in the median.
constexpr double kMovedShare = 0.4;

} // namespace

std::string TrackIdCheck::note(const StereoFrame& frame) {
  if (windows_ == kWindows) return {};
  std::map<std::uint64_t, Eigen::Vector2d> now;
  for (const StereoFeatureObservation& feature : frame.features) {
    if (feature.pixels.allFinite()) now.emplace(feature.id, feature.pixels.head<2>());
  }
  if (!previous_.empty()) followable_ += now.size();
  std::vector<Eigen::Vector2d> moved;
  std::vector<double> columns, rows;
  for (const auto& [id, pixel] : now) {
    const auto same = previous_.find(id);
    if (same == previous_.end()) continue;
    const auto next = std::next(same) == previous_.end() ? previous_.begin() : std::next(same);
    apart_.push_back((pixel - next->second).norm());
    moved.push_back(pixel - same->second);
    columns.push_back(moved.back().x());
    rows.push_back(moved.back().y());
  }
  previous_ = std::move(now);
  if (!moved.empty()) {
    const Eigen::Vector2d common(medianOf(columns), medianOf(rows)); // the rig turns
    for (const Eigen::Vector2d& way : moved) moved_.push_back((way - common).norm());
  }
  if (++frames_ < kWindowFrames || followable_ < kWindowPoints) return {};
  std::string said = judge();
  windows_ = said.empty() ? windows_ + 1 : kWindows;
  frames_ = followable_ = 0;
  moved_ = apart_ = {};
  if (windows_ == kWindows) previous_ = {};
  return said;
}

std::string TrackIdCheck::judge() const {
  const std::string advice = "; a point must keep its id as long as it is followed, and no other may get it";
  const double share = static_cast<double>(moved_.size()) / static_cast<double>(followable_);
  if (share < kFollowedShare)
    return "ids do not last: " + rounded(100.0 * share) +
           " % of the points were in the frame before, allowed: at least " + rounded(100.0 * kFollowedShare) +
           " %" + advice;
  const double moved = medianOf(moved_), allowed = kMovedShare * medianOf(apart_);
  if (moved <= allowed) return {};
  return "ids do not follow points: against each other they move by " + rounded(moved) +
         " px a frame (median of " + std::to_string(moved_.size()) + "), allowed: " + rounded(allowed) +
         " px, by which other points are apart" + advice;
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/sensors/stereo_check.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "vi_ekf_slam/core/sensors/median.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

// Pairs: how many are judged.
constexpr std::size_t kJudgedFrames = 10, kJudgedPoints = 200;
// Of a normal variable, the median of the magnitude is 0.674 sigma; rows differ by sqrt(2) sigma of a
// coordinate.
constexpr double kMedianOfRows = 0.674 * 1.414;
// Of the median that noise makes (no sample of so many points has it by chance), and of the stated noise: 3.6
// standard deviations of the median of kJudgedPoints.
constexpr double kRowFactor = 2.4, kNoiseFactor = 1.3;
constexpr double kMaxMedianRow = 1.5;   // px: the front end takes no more (front_end/stereo_matcher.cpp)
constexpr double kClearDisparity = 1.0; // px: less disparity has no sign
constexpr double kBehindShare = 0.6;    // share of points behind the cameras

// Ids. A rig at rest has ids that seem to follow points, and may begin to move later.
constexpr std::size_t kWindows = 10, kWindowFrames = 10, kWindowPoints = 200;
constexpr double kFollowedShare = 0.1; // of the points; tracks that end after a frame tell nothing
// Of the way to some other point of the frame before, without the way that all have in common. Tracks of nine
// recorded and simulated drives move by at most 0.18 of it in any ten frames, ids that count the points of
// each frame by 0.6 to 1 in the median.
constexpr double kMovedShare = 0.4;

} // namespace

std::string PairCheck::note(const StereoFrame& frame, double pixel_sigma) {
  if (is_done_) return {};
  for (const StereoFeatureObservation& feature : frame.features) {
    const StereoPixels& p = feature.pixels; // uL vL uR vR
    if (!p.allFinite()) continue;
    rows_.push_back(std::abs(p[1] - p[3]));
    sigmas_.push_back(feature.sigma > 0.0 && std::isfinite(feature.sigma) ? feature.sigma : pixel_sigma);
    const double disparity = p[0] - p[2];
    if (std::abs(disparity) > kClearDisparity) ++clear_;
    if (disparity < -kClearDisparity) ++behind_;
  }
  if (++frames_ < kJudgedFrames || rows_.size() < kJudgedPoints) return {};
  is_done_ = true;
  const std::string said = judge();
  rows_ = sigmas_ = {};
  return said;
}

std::string PairCheck::judge() const {
  const double share = static_cast<double>(behind_) / static_cast<double>(std::max<std::size_t>(1, clear_));
  if (share > kBehindShare && clear_ >= kJudgedPoints / 2)
    return "disparity has the wrong sign: " + rounded(100.0 * share) +
           " % of the points are behind the cameras, allowed: " + rounded(100.0 * kBehindShare) +
           " %; exchange left and right: u_left must be the larger one";
  const double error = medianOf(rows_);
  const double stated = medianOf(sigmas_), noise = error / kMedianOfRows;
  const double limit = std::max(kMaxMedianRow, kRowFactor * kMedianOfRows * stated);
  const std::string count = " px (median of " + std::to_string(rows_.size()) + " points), ";
  if (error > limit)
    return "matched points lie in different rows: " + rounded(error) + count + "allowed: " + rounded(limit) +
           " px; the features are not those of rectified pictures: rectify their pixels with D, K, R and P "
           "of camera_info; or their noise is " +
           rounded(noise) + " px, stated: " + rounded(stated) +
           " px (invariant/pixel_sigma, sigma of the features)";
  if (noise > kNoiseFactor * stated)
    return "pixel noise is larger than stated: rows of matched points differ by " + rounded(error) + count +
           "as noise of " + rounded(noise) + " px makes them, stated: " + rounded(stated) +
           " px; the covariance is too small: state the noise that there is (invariant/pixel_sigma, sigma of "
           "the features), or rectify more exactly";
  return {};
}

std::string TrackIdCheck::note(const StereoFrame& frame) {
  if (windows_ == kWindows) return {};
  std::map<FeatureId, Eigen::Vector2d> now;
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

std::string StereoCheck::note(const StereoFrame& frame, double pixel_sigma) {
  std::string said = pair_.note(frame, pixel_sigma);
  addProblem(said, ids_.note(frame));
  addProblem(problem_, said);
  return said;
}

} // namespace vi_ekf_slam

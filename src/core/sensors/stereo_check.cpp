#include "vi_ekf_slam/core/sensors/stereo_check.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kJudgedFrames = 10, kJudgedPoints = 200; // that are judged
// Of a normal variable, the median of the magnitude is 0.674 sigma; rows differ by sqrt(2) sigma of a
// coordinate.
constexpr double kMedianOfRows = 0.674 * 1.414;
constexpr double kRowFactor =
    2.4; // of the median that noise makes: no sample of so many points has it by chance
constexpr double kMaxMedianRow =
    1.5; // px, beyond which the front end takes no match (front_end/stereo_matcher.cpp)
constexpr double kClearDisparity = 1.0; // px: less disparity has no sign
constexpr double kBehindShare = 0.6;    // share of points behind the cameras
constexpr std::size_t kIdWindows = 10;  // of so many frames: a rig at rest has ids that seem to follow
constexpr double kFollowedShare = 0.1;  // of the points; tracks that end after a frame tell nothing
// Of the way to some other point of the frame before, without the way that all have in common. Tracks of nine
// recorded and simulated drives move by at most 0.18 of it in any ten frames, ids that count the points of
// each frame by 0.6 to 1 in the median.
constexpr double kMovedShare = 0.4;

double medianOfValues(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

} // namespace

std::string StereoCheck::note(const StereoFrame& frame, double pixel_sigma) {
  const std::string of_pair = judged_ ? "" : notePair(frame, pixel_sigma);
  const std::string of_ids = id_windows_ == kIdWindows ? "" : noteIds(frame);
  const std::string said = of_pair + (of_pair.empty() || of_ids.empty() ? "" : "; ") + of_ids;
  if (!said.empty()) problem_ += (problem_.empty() ? "" : "; ") + said;
  return said;
}

std::string StereoCheck::notePair(const StereoFrame& frame, double pixel_sigma) {
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
  judged_ = true;
  const std::string said = judge();
  rows_ = sigmas_ = {};
  return said;
}

std::string StereoCheck::noteIds(const StereoFrame& frame) {
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
    const Eigen::Vector2d common(medianOfValues(columns), medianOfValues(rows)); // the rig turns
    for (const Eigen::Vector2d& way : moved) moved_.push_back((way - common).norm());
  }
  if (++id_frames_ < kJudgedFrames || followable_ < kJudgedPoints) return {};
  std::string said = idProblem();
  id_windows_ = said.empty() ? id_windows_ + 1 : kIdWindows;
  id_frames_ = followable_ = 0;
  moved_ = apart_ = {};
  if (id_windows_ == kIdWindows) previous_ = {};
  return said;
}

std::string StereoCheck::idProblem() const {
  const std::string advice = "; a point must keep its id as long as it is followed, and no other may get it";
  const double share = static_cast<double>(moved_.size()) / static_cast<double>(followable_);
  if (share < kFollowedShare)
    return "ids do not last: " + rounded(100.0 * share) +
           " % of the points were in the frame before, allowed: at least " + rounded(100.0 * kFollowedShare) +
           " %" + advice;
  const double moved = medianOfValues(moved_), allowed = kMovedShare * medianOfValues(apart_);
  if (moved <= allowed) return {};
  return "ids do not follow points: against each other they move by " + rounded(moved) +
         " px a frame (median of " + std::to_string(moved_.size()) + "), allowed: " + rounded(allowed) +
         " px, by which other points are apart" + advice;
}

std::string StereoCheck::judge() const {
  const double share = static_cast<double>(behind_) / static_cast<double>(std::max<std::size_t>(1, clear_));
  if (share > kBehindShare && clear_ >= kJudgedPoints / 2)
    return "disparity has the wrong sign: " + rounded(100.0 * share) +
           " % of the points are behind the cameras, allowed: " + rounded(100.0 * kBehindShare) +
           " %; exchange left and right: u_left must be the larger one";
  const double error = medianOfValues(rows_);
  const double limit = std::max(kMaxMedianRow, kRowFactor * kMedianOfRows * medianOfValues(sigmas_));
  if (error <= limit) return {};
  return "matched points lie in different rows: " + rounded(error) + " px (median of " +
         std::to_string(rows_.size()) + " points), allowed: " + rounded(limit) +
         " px; the features are not those of rectified pictures: rectify their pixels with D, K, R and P of "
         "camera_info";
}

} // namespace vi_ekf_slam

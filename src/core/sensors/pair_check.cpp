#include "vi_ekf_slam/core/sensors/pair_check.hpp"

#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/sensors/median.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kJudgedFrames = 10, kJudgedPoints = 200; // that are judged
// Of a normal variable, the median of the magnitude is 0.674 sigma; rows differ by sqrt(2) sigma of a
// coordinate.
constexpr double kMedianOfRows = 0.674 * 1.414;
constexpr double kRowFactor =
    2.4; // of the median that noise makes: no sample of so many points has it by chance
constexpr double kNoiseFactor =
    1.3; // of the stated noise: 3.6 standard deviations of the median of kJudgedPoints
constexpr double kMaxMedianRow =
    1.5; // px, beyond which the front end takes no match (front_end/stereo_matcher.cpp)
constexpr double kClearDisparity = 1.0; // px: less disparity has no sign
constexpr double kBehindShare = 0.6;    // share of points behind the cameras

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

} // namespace vi_ekf_slam

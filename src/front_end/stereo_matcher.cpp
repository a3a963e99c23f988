#include "vi_ekf_slam/front_end/stereo_matcher.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/front_end/flow.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kSearchLevel = 2; // of the pyramid: a quarter of the resolution
constexpr int kScale = 1 << kSearchLevel;
constexpr int kHalfWindow = 4, kSide = 2 * kHalfWindow + 1; // px at that level
constexpr float kMinWindowContrast = 1.0f;                  // grey levels, RMS
constexpr int kCurveStep = 8; // steps of the search between two points of the exact curve
constexpr float kMinCorrelation = 0.7f;
constexpr double kNearest = 0.25;           // of the image's width, the largest disparity
constexpr double kMaxRowError = 1.5;        // px
constexpr float kMaxStereoRoundTrip = 0.5f; // px
constexpr double kMinDisparity = -1.0;      // px; a point at infinity has 0, with noise

/// A window of the search level, its mean removed and its norm 1; false where it is flat or not inside.
// With zeros up to a multiple of every vector register, as AnchorPatch has it.
constexpr int kPixels = kSide * kSide, kPadded = (kPixels + 15) / 16 * 16;
using Window = Eigen::Matrix<float, kPadded, 1>;

bool cut(const cv::Mat& level, const cv::Point2f& pixel, Window& window) {
  const int x = cvRound(pixel.x / kScale) - kHalfWindow, y = cvRound(pixel.y / kScale) - kHalfWindow;
  if (x < 0 || y < 0 || x + kSide > level.cols || y + kSide > level.rows) return false;
  for (int r = 0; r < kSide; ++r) {
    window.segment<kSide>(r * kSide) =
        Eigen::Map<const Eigen::Matrix<std::uint8_t, kSide, 1>>(level.ptr<std::uint8_t>(y + r) + x)
            .cast<float>();
  }
  window.tail<kPadded - kPixels>().setZero();
  window.head<kPixels>().array() -= window.sum() / kPixels;
  const float norm = window.norm();
  if (norm < kMinWindowContrast * kSide) return false;
  window /= norm;
  return true;
}

} // namespace

StereoMatcher::StereoMatcher(const StereoCalibration& calibration)
    : calibration_(calibration), max_disparity_(kNearest * calibration.left.size().width) {}

std::vector<StereoMatcher::Place> StereoMatcher::search(const Picture& left, const Picture& right,
                                                        const std::vector<StereoQuery>& queries,
                                                        double sign) const {
  const cv::Mat& left_level = left.pyramid[2 * kSearchLevel]; // images and derivatives in turns
  const cv::Mat& right_level = right.pyramid[2 * kSearchLevel];
  const int steps = static_cast<int>(max_disparity_ / kScale);
  std::vector<Place> found(queries.size(), {{}, kMinCorrelation});
  Window here, there;
  for (std::size_t i = 0; i < queries.size(); ++i) {
    if (!cut(left_level, queries[i].left, here)) continue;
    const double step = sign * kScale * queries[i].magnification;
    // Straight between points so near to each other.
    std::vector<cv::Point2d> curve;
    for (int k = 0; k <= steps + kCurveStep; k += kCurveStep)
      curve.push_back(queries[i].left_rectified - cv::Point2d(k * step, 0.0));
    const auto pixels = calibration_.right.unrectify(curve);
    for (int k = 0; k <= steps; ++k) {
      const std::size_t piece = static_cast<std::size_t>(k / kCurveStep);
      const float share = static_cast<float>(k % kCurveStep) / kCurveStep;
      const cv::Point2f pixel = (1.0f - share) * pixels[piece] + share * pixels[piece + 1];
      if (!cut(right_level, pixel, there)) continue;
      const float correlation = here.dot(there);
      if (correlation <= found[i].correlation) continue;
      found[i] = {k * step, correlation};
    }
  }
  return found;
}

std::vector<StereoMatch> StereoMatcher::match(const Picture& left, const Picture& right,
                                              const std::vector<StereoQuery>& queries) const {
  std::vector<StereoQuery> unknown;
  for (const auto& query : queries) {
    if (!query.disparity) unknown.push_back(query);
  }
  const auto searched = search(left, right, unknown, 1.0);
  std::vector<StereoMatch> matches(queries.size());
  for (const bool is_known : {false, true}) {
    std::vector<cv::Point2f> points;
    std::vector<cv::Point2d> places;
    std::vector<std::size_t> of;
    std::size_t next = 0;
    for (std::size_t i = 0; i < queries.size(); ++i) {
      if (queries[i].disparity.has_value() != is_known) continue;
      const auto disparity = is_known ? queries[i].disparity : searched[next++].disparity;
      if (!disparity) continue;
      points.push_back(queries[i].left);
      places.push_back(queries[i].left_rectified - cv::Point2d(*disparity, 0.0));
      of.push_back(i);
    }
    const int levels = is_known ? 0 : 1; // a search knows to a quarter of the resolution
    const Flow flow =
        followPoints(left, right, points, calibration_.right.unrectify(places), levels, kMaxStereoRoundTrip);
    const auto rectified = calibration_.right.rectify(flow.points);
    for (std::size_t k = 0; k < of.size(); ++k) {
      const cv::Point2d& at = queries[of[k]].left_rectified;
      StereoMatch& match = matches[of[k]];
      match.right = flow.points[k];
      match.right_rectified = rectified[k];
      const double disparity = at.x - rectified[k].x;
      const double wide = queries[of[k]].magnification;
      const bool is_seen = flow.found[k] && disparity >= kMinDisparity * wide &&
                           disparity <= (max_disparity_ + kScale) * wide &&
                           calibration_.right.shows(rectified[k]);
      match.off_row = is_seen && std::abs(at.y - rectified[k].y) > kMaxRowError * wide;
      match.found = is_seen && !match.off_row;
    }
  }
  return matches;
}

bool StereoMatcher::lookExchanged(const Picture& left, const Picture& right,
                                  const std::vector<StereoQuery>& queries) const {
  const auto backward = search(left, right, queries, -1.0), forward = search(left, right, queries, 1.0);
  std::size_t count = 0;
  for (std::size_t i = 0; i < queries.size(); ++i) { // what is of one kind is found on both sides
    const bool is_behind = backward[i].correlation > forward[i].correlation;
    count += is_behind && *backward[i].disparity <= -kScale * queries[i].magnification ? 1 : 0;
  }
  return 2 * count > queries.size();
}

} // namespace vi_ekf_slam

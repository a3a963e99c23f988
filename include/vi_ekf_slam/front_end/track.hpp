#pragma once

#include <memory>
#include <optional>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/front_end/anchor_patch.hpp"

namespace vi_ekf_slam {

/// px, how far a new anchor leads a track away where flow alone knows how it went on, against the points that
/// tracks began at on drawn streets: the mean of columns and rows, 0.84 and 0.35, that two thirds are within
/// (docs/front_end.md).
constexpr double kByFlow = 0.6;

/// One point that is followed.
struct Track {
  FeatureId id = 0;
  Stamp begin = 0;
  cv::Point2f left;                  ///< px, in the image that came
  cv::Point2f left_before;           ///< px, in the image of the pair before
  cv::Point2d left_rectified;        ///< px
  double magnification = 1.0;        ///< rectified px for one px of the image that came
  cv::Point2f right;                 ///< px, in the image that came; valid where matched
  cv::Point2d right_rectified;       ///< px
  std::optional<double> disparity;   ///< px, of the last match, or where the camera moved since then
  /// m, in the rectified left camera of the pair before; far away where its disparity is not known.
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  bool matched = false;              ///< in the last pair
  int unmatched = 0;                 ///< pairs in a row without a match
  /// What it looked like when it began, or since its looks changed.
  std::unique_ptr<const AnchorPatch> anchor;
  AnchorPatch::Warp warp;            ///< of the anchor to the last left image
  double strayed =
      0.0; ///< px, STANDARD DEVIATION of how far new anchors have led it away since it last went out
  std::optional<Descriptor> descriptor; ///< of the left image of the pair that `described` says
  Stamp described = 0;
  double square_sum = 0.0, weight = 0.0; ///< px^2 of the image that came and count, of its row residuals
};

/// Where a track should be in the image that comes.
struct TrackPrediction {
  cv::Point2f pixel;
  float magnification = 1.0f; ///< against the image before
};

/// Aligns what the track's anchor shows with the image `now`, or else what image `before` shows where the
/// track was, which is its anchor then. False, and the track as it was, where neither looks like it within
/// `reach` px of the prediction.
bool alignTrack(const cv::Mat& before, const cv::Mat& now, const TrackPrediction& prediction, float reach,
                Track& track);

/// Puts the track where it is in the image `now`, by other means than its looks, and begins a new anchor
/// there.
void anchorAnew(const cv::Mat& now, const cv::Point2f& pixel, Track& track);

} // namespace vi_ekf_slam

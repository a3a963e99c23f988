#pragma once

#include <optional>
#include <vector>

#include "vi_ekf_slam/front_end/picture.hpp"
#include "vi_ekf_slam/front_end/stereo_calibration.hpp"

namespace vi_ekf_slam {

/// A point of the left picture, and what is known of its place in the right one.
struct StereoQuery {
  cv::Point2f left;                ///< px in the image that came
  cv::Point2d left_rectified;      ///< px
  double magnification;            ///< rectified px for one px of the image that came
  std::optional<double> disparity; ///< px, of the frame before; nothing: looked for over the whole range
};

struct StereoMatch {
  cv::Point2f right;           ///< px in the image that came
  cv::Point2d right_rectified; ///< px
  bool found = false;
  bool off_row = false; ///< it would be found, were it in its row
};

/// Finds the points of the left picture in the right one. What has no disparity yet is looked for along the
/// epipolar curve at a quarter of the resolution; then optical flow, to a fraction of a pixel and back again.
class StereoMatcher {
 public:
  /// `calibration` must outlive this.
  explicit StereoMatcher(const StereoCalibration& calibration);

  std::vector<StereoMatch> match(const Picture& left, const Picture& right,
                                 const std::vector<StereoQuery>& queries) const;

  /// Whether the pictures look exchanged: of these points most are found to the right of where they are on
  /// the left, and look less like anything to the left of it.
  bool lookExchanged(const Picture& left, const Picture& right,
                     const std::vector<StereoQuery>& queries) const;

 private:
  struct Place {
    std::optional<double> disparity; ///< px; nothing: it is not found
    float correlation;               ///< of it; else what it must exceed
  };

  std::vector<Place> search(const Picture& left, const Picture& right,
                            const std::vector<StereoQuery>& queries, double sign) const;

  const StereoCalibration& calibration_;
  double max_disparity_; ///< px of the images that come
};

} // namespace vi_ekf_slam

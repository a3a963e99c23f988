#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace vi_ekf_slam {

/// New corners, spread over the image: one in each cell of a grid that has none yet, the one with the largest
/// smaller eigenvalue of the structure tensor (Shi and Tomasi), if that is enough to follow it; more where
/// the grid alone does not make up the number.
class CornerDetector {
 public:
  /// `count`: points that are wanted in all.
  CornerDetector(cv::Size image, std::size_t count);

  /// `occupied`: where points are already, px.
  std::vector<cv::Point2f> detect(const cv::Mat& image, const std::vector<cv::Point2f>& occupied);
  /// A corner was of no use: its cell is left alone for the next few images.
  void noteFailure(const cv::Point2f& corner);
  /// Every part is looked at again in the next picture.
  void forgetFailures();

  /// px, between two points.
  float minDistance() const { return 0.35f * static_cast<float>(cell_); }

 private:
  std::size_t cellOf(const cv::Point2f& point) const;

  cv::Size image_;
  std::size_t count_;
  int cell_; ///< px, side of a cell
  cv::Size grid_;
  std::vector<int> rests_; ///< of each cell: images for which it is left alone
};

} // namespace vi_ekf_slam

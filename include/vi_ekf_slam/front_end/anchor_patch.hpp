#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>

namespace vi_ekf_slam {

/// What a point looked like where its track began, and where exactly that is in a later image. Flow from
/// image to image adds up its errors; this does not. The patch is that of a plane, and may change brightness
/// and contrast.
class AnchorPatch {
 public:
  /// Takes x = centre + shape xi / (1 + slant^T xi), for xi in the patch (px): what a camera that moves sees
  /// of a plane. Without slant the points of a wall along which it drives stray to the outside.
  struct Warp {
    Eigen::Vector2f centre = Eigen::Vector2f::Zero(); ///< px
    Eigen::Matrix2f shape = Eigen::Matrix2f::Identity();
    Eigen::Vector2f slant = Eigen::Vector2f::Zero(); ///< 1/px
  };

  /// Shift, shape and slant, each in px at the patch's edge.
  using Parameters = Eigen::Matrix<float, 8, 1>;

  struct Fit {
    Warp warp;
    double correlation = 0.0; ///< normalised, of the patch and what lies there
  };

  /// Half of the patch's side, px, of the centres of its outermost pixels.
  static constexpr int kHalf = 7;
  static constexpr int kSide = 2 * kHalf + 1;
  static constexpr int kPixels = kSide * kSide;

  /// Nothing where the patch is not inside the image or has no contrast.
  static std::unique_ptr<const AnchorPatch> cut(const cv::Mat& image, const cv::Point2f& centre);

  /// Gauss-Newton with the gradients of both images (efficient second-order minimisation, Benhimane and Malis
  /// 2004), from `start`, near which the shape is expected; nothing where it leaves the image or does not
  /// converge.
  std::optional<Fit> align(const cv::Mat& image, const Warp& start) const;

 private:
  // Filled up with zeros to a multiple of every vector register: Eigen then aligns them, and the order in
  // which it sums, and so the last digit, does not depend on where in memory they are.
  static constexpr int kPadded = (kPixels + 15) / 16 * 16;
  using Pixels = Eigen::Matrix<float, kPadded, 1>;

  struct View {
    Pixels values = Pixels::Zero();                        ///< mean 0, norm 1
    Pixels across = Pixels::Zero(), down = Pixels::Zero(); ///< their gradient, 1/px of the patch
  };

  /// Normal equations of the step, without what brightness and contrast explain.
  struct Normal {
    Eigen::Matrix<float, 8, 8> H;
    Parameters b;
  };

  /// False where it is not inside the image or has no contrast.
  static bool look(const cv::Mat& image, const Warp& warp, View& view);

  Normal linearise(const View& there, float correlation) const;

  View view_; ///< where it was cut
};

} // namespace vi_ekf_slam

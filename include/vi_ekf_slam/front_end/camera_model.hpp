#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace vi_ekf_slam {

/// One camera: how the points of its images lie in the rectified image. Matrices and the coefficients' order
/// are those of sensor_msgs/CameraInfo.
class CameraModel {
 public:
  enum class Distortion { kPolynomial, kEquidistant };

  struct Parameters {
    cv::Size size; ///< px
    Distortion distortion = Distortion::kPolynomial;
    std::vector<double> D;              ///< 0, 4, 5, 8, 12 or 14 of polynomials, as OpenCV; 4 of equidistant
    cv::Matx33d K = cv::Matx33d::eye(); ///< px, of the raw image
    cv::Matx33d R = cv::Matx33d::eye(); ///< rectified_R_raw
    cv::Matx33d P = cv::Matx33d::eye(); ///< px, of the rectified image
    bool images_are_rectified = false;  ///< what comes is the rectified image: D, K and R do not count
  };

  /// Throws std::invalid_argument, which names the value and what is allowed.
  explicit CameraModel(const Parameters& parameters);

  /// Pixels of the images that come -> rectified pixels, which of a raw image can lie beyond the rectified
  /// one's borders. A point too far from the axis for a plane comes out far away.
  std::vector<cv::Point2d> rectify(const std::vector<cv::Point2f>& pixels) const;
  /// The way back. A point behind the camera, or beyond the field in which the distortion is one to one,
  /// comes out far outside.
  std::vector<cv::Point2f> unrectify(const std::vector<cv::Point2d>& rectified) const;

  /// How many pixels of the rectified image a pixel of the images that come is long there, where it is
  /// longest: what turns an error of the one into one of the other that is not too small. 1 where `shows` is
  /// false.
  std::vector<double> magnifications(const std::vector<cv::Point2d>& rectified) const;

  cv::Size size() const { return parameters_.size; }
  bool imagesAreRectified() const { return parameters_.images_are_rectified; }
  const Parameters& parameters() const { return parameters_; }

  /// Whether a pixel lies in an image of this size.
  bool contains(const cv::Point2d& pixel) const;
  /// Whether the images that come can show what has this rectified pixel.
  bool shows(const cv::Point2d& rectified) const;

 private:
  void setFieldOfView();
  /// Rectified pixels -> those of the images that come, wherever they are; the axis for those behind it.
  std::vector<cv::Point2d> distort(const std::vector<cv::Point2d>& rectified) const;
  bool isBeyondPlane(const cv::Point2d& raw) const;

  Parameters parameters_;
  cv::Matx33d raw_from_pixel_; ///< direction in the raw camera's axes of a rectified pixel
  double max_tangent_ = 0.0;   ///< of the angle from the raw image's axis, at its farthest corner
};

/// Whether a CameraInfo's D, R, K and P say that nothing is left to rectify.
bool isRectified(const CameraModel::Parameters& parameters);

} // namespace vi_ekf_slam

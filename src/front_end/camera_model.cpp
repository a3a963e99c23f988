#include "vi_ekf_slam/front_end/camera_model.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <stdexcept>

namespace vi_ekf_slam {
namespace {

constexpr double kFarOutside = -1e6; // px
constexpr double kMaxTangent = 10.0; // 84 deg from the axis; beyond it a rectified image has no pixels
// Newton's and the fixed-point iterations of OpenCV, to a thousandth of a pixel's noise.
const cv::TermCriteria kUndistort(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 1e-6);

bool isClose(const cv::Matx33d& a, const cv::Matx33d& b, double tolerance) {
  return cv::norm(a - b, cv::NORM_INF) <= tolerance;
}

std::vector<cv::Point2d> toDouble(const std::vector<cv::Point2f>& points) {
  return {points.begin(), points.end()};
}

} // namespace

CameraModel::CameraModel(const Parameters& parameters) : parameters_(parameters) {
  const auto fail = [](const std::string& text) { throw std::invalid_argument(text); };
  const auto& p = parameters_;
  if (p.size.width < 32 || p.size.height < 32 || p.size.width > 16384 || p.size.height > 16384)
    fail("width x height is " + std::to_string(p.size.width) + " x " + std::to_string(p.size.height) +
         ", allowed: 32 to 16384 px");
  if (!cv::checkRange(p.K) || !cv::checkRange(p.R) || !cv::checkRange(p.P) || !cv::checkRange(p.D))
    fail("D, K, R or P is not finite");
  if (!(p.P(0, 0) > 0.0 && p.P(1, 1) > 0.0)) fail("focal lengths in P must be positive");
  if (p.images_are_rectified) return;
  if (!(p.K(0, 0) > 0.0 && p.K(1, 1) > 0.0)) fail("focal lengths in K must be positive");
  if (!isClose(p.R * p.R.t(), cv::Matx33d::eye(), 1e-3) || cv::determinant(p.R) < 0.0)
    fail("R is not a rotation (R R^T = I within 1e-3, det R = 1)");
  const std::size_t n = p.D.size();
  if (p.distortion == Distortion::kEquidistant ? n != 4 : n != 0 && n != 4 && n != 5 && n != 8)
    fail("D has " + std::to_string(n) +
         " coefficients, allowed: 4 (equidistant), 0, 4 or 5 (plumb_bob), 8 (rational_polynomial)");
  setFieldOfView();
}

/// Beyond the image's corners a polynomial is not fitted to anything, and need not be monotonic.
void CameraModel::setFieldOfView() {
  const float w = static_cast<float>(parameters_.size.width), h = static_cast<float>(parameters_.size.height);
  max_tangent_ = kMaxTangent;
  std::vector<cv::Point2d> corners;
  for (const cv::Point2d& q : rectify({{0, 0}, {w, 0}, {0, h}, {w, h}})) {
    const cv::Vec3d ray = parameters_.R.t() * (parameters_.P.inv() * cv::Vec3d(q.x, q.y, 1.0));
    const bool is_seen = q.x > kFarOutside && q.y > kFarOutside && ray[2] > 0.0;
    if (is_seen) corners.emplace_back(ray[0] / ray[2], ray[1] / ray[2]);
  }
  if (corners.size() < 4) return; // a fisheye's corners, which no ray ahead meets
  max_tangent_ = 0.0;
  for (const auto& corner : corners) max_tangent_ = std::max(max_tangent_, 1.05 * cv::norm(corner));
}

std::vector<cv::Point2d> CameraModel::rectify(const std::vector<cv::Point2f>& pixels) const {
  const std::vector<cv::Point2d> raw = toDouble(pixels);
  if (parameters_.images_are_rectified || raw.empty()) return raw;
  std::vector<cv::Point2d> rectified;
  if (parameters_.distortion == Distortion::kEquidistant) {
    cv::fisheye::undistortPoints(raw, rectified, parameters_.K, parameters_.D, parameters_.R, parameters_.P);
  } else {
    cv::undistortPoints(raw, rectified, parameters_.K, parameters_.D, parameters_.R, parameters_.P,
                        kUndistort);
  }
  for (auto& q : rectified) {
    const bool is_sane = std::isfinite(q.x) && std::isfinite(q.y) && std::abs(q.x) < -kFarOutside &&
                         std::abs(q.y) < -kFarOutside;
    if (!is_sane) q = {kFarOutside, kFarOutside};
  }
  return rectified;
}

std::vector<cv::Point2f> CameraModel::unrectify(const std::vector<cv::Point2d>& rectified) const {
  std::vector<cv::Point2f> pixels;
  if (parameters_.images_are_rectified || rectified.empty()) {
    pixels.assign(rectified.begin(), rectified.end());
    return pixels;
  }
  const cv::Matx33d raw_from_pixel = parameters_.R.t() * parameters_.P.inv();
  std::vector<cv::Point3d> rays;
  std::vector<bool> is_seen;
  for (const auto& q : rectified) {
    const cv::Vec3d ray = raw_from_pixel * cv::Vec3d(q.x, q.y, 1.0);
    const bool seen = ray[2] > 0.0 && std::hypot(ray[0], ray[1]) <= max_tangent_ * ray[2];
    rays.emplace_back(seen ? ray[0] / ray[2] : 0.0, seen ? ray[1] / ray[2] : 0.0, 1.0);
    is_seen.push_back(seen);
  }
  std::vector<cv::Point2d> raw;
  const cv::Vec3d none(0.0, 0.0, 0.0);
  if (parameters_.distortion == Distortion::kEquidistant) {
    cv::fisheye::projectPoints(rays, raw, none, none, parameters_.K, parameters_.D);
  } else {
    cv::projectPoints(rays, none, none, parameters_.K, parameters_.D, raw);
  }
  for (std::size_t i = 0; i < raw.size(); ++i)
    pixels.push_back(is_seen[i]
                         ? cv::Point2f(raw[i])
                         : cv::Point2f(static_cast<float>(kFarOutside), static_cast<float>(kFarOutside)));
  return pixels;
}

bool CameraModel::contains(const cv::Point2d& pixel, double border) const {
  return pixel.x >= border && pixel.y >= border && pixel.x <= parameters_.size.width - 1 - border &&
         pixel.y <= parameters_.size.height - 1 - border;
}

bool isRectified(const CameraModel::Parameters& p) {
  const bool undistorted = std::all_of(p.D.begin(), p.D.end(), [](double d) { return d == 0.0; }) &&
                           p.distortion == CameraModel::Distortion::kPolynomial;
  return undistorted && isClose(p.R, cv::Matx33d::eye(), 1e-9) && isClose(p.K, p.P, 1e-3);
}

} // namespace vi_ekf_slam

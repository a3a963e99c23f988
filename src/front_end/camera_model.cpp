#include "vi_ekf_slam/front_end/camera_model.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <opencv2/calib3d.hpp>
#include <stdexcept>
#include <string>

#include "vi_ekf_slam/front_end/picture.hpp"

namespace vi_ekf_slam {
namespace {

// px; of less OpenCV's pyramid has no level in which stereo matches are looked for.
constexpr int kSmallest = (kWindow << kLevels) + 1, kLargest = 16384;
constexpr double kFarOutside = -1e6; // px
// 63 deg from the axis. There a fisheye's pixel is 5 times as long in a plane as in its middle, and ever
// longer.
constexpr double kMaxTangent = 2.0;
// What a polynomial's radius must grow by with the tangent to be inverted: a tenth of what it does in the
// middle.
constexpr double kLeastSlope = 0.1, kTangentStep = 0.005;
constexpr double kMaxReturn = 0.5; // px
// Newton's and the fixed-point iterations of OpenCV, to a thousandth of a pixel's noise.
const cv::TermCriteria kUndistort(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 1e-6);

bool isClose(const cv::Matx33d& a, const cv::Matx33d& b, double tolerance) {
  return cv::norm(a - b, cv::NORM_INF) <= tolerance;
}

/// Radius in the raw image, over the focal length, of what is seen at this tangent of the angle from the
/// axis. Without the decentring, the thin prism and the sensor's tilt, which only shift it.
double bentRadius(const std::vector<double>& D, double tangent) {
  const auto d = [&D](std::size_t i) { return i < D.size() ? D[i] : 0.0; };
  const double t = tangent * tangent;
  return tangent * (1.0 + t * (d(0) + t * (d(1) + t * d(4)))) / (1.0 + t * (d(5) + t * (d(6) + t * d(7))));
}

/// As far as what is farther from the axis is farther out in the image.
double risesUpTo(const std::vector<double>& D) {
  double tangent = kTangentStep, radius = bentRadius(D, tangent);
  while (tangent < kMaxTangent) {
    const double next = bentRadius(D, tangent + kTangentStep);
    if (!(next - radius > kLeastSlope * kTangentStep)) break;
    tangent += kTangentStep;
    radius = next;
  }
  return std::min(tangent, kMaxTangent);
}

std::vector<cv::Point2d> toDouble(const std::vector<cv::Point2f>& points) {
  return {points.begin(), points.end()};
}

} // namespace

CameraModel::CameraModel(const Parameters& parameters) : parameters_(parameters) {
  const auto fail = [](const std::string& text) { throw std::invalid_argument(text); };
  const auto& p = parameters_;
  if (std::min(p.size.width, p.size.height) < kSmallest || std::max(p.size.width, p.size.height) > kLargest)
    fail("width x height is " + std::to_string(p.size.width) + " x " + std::to_string(p.size.height) +
         ", allowed: " + std::to_string(kSmallest) + " to " + std::to_string(kLargest) + " px");
  if (!cv::checkRange(p.K) || !cv::checkRange(p.R) || !cv::checkRange(p.P) || !cv::checkRange(p.D))
    fail("D, K, R or P is not finite");
  if (!(p.P(0, 0) > 0.0 && p.P(1, 1) > 0.0)) fail("focal lengths in P must be positive");
  raw_from_pixel_ = p.R.t() * p.P.inv();
  if (p.images_are_rectified) return;
  if (!(p.K(0, 0) > 0.0 && p.K(1, 1) > 0.0)) fail("focal lengths in K must be positive");
  if (!isClose(p.R * p.R.t(), cv::Matx33d::eye(), 1e-3) || cv::determinant(p.R) < 0.0)
    fail("R is not a rotation (R R^T = I within 1e-3, det R = 1)");
  static constexpr std::size_t kOfPolynomials[] = {0, 4, 5, 8, 12, 14}; // what OpenCV takes
  const std::size_t n = p.D.size();
  if (p.distortion == Distortion::kEquidistant
          ? n != 4
          : std::count(std::begin(kOfPolynomials), std::end(kOfPolynomials), n) == 0)
    fail("D has " + std::to_string(n) +
         " coefficients, allowed: 4 (equidistant), 0, 4 or 5 (plumb_bob), 8, 12 or 14 (rational_polynomial)");
  setFieldOfView();
}

/// Beyond the image's corners a polynomial is not fitted to anything, and need not be monotonic; of a wide
/// lens it need not be so up to them.
void CameraModel::setFieldOfView() {
  const float w = static_cast<float>(parameters_.size.width), h = static_cast<float>(parameters_.size.height);
  max_tangent_ = parameters_.distortion == Distortion::kPolynomial ? risesUpTo(parameters_.D) : kMaxTangent;
  double farthest = 0.0;
  for (const cv::Point2d& q : rectify({{0, 0}, {w, 0}, {0, h}, {w, h}})) {
    if (!shows(q)) return; // a corner that no direction of the plane is seen in
    const cv::Vec3d ray = raw_from_pixel_ * cv::Vec3d(q.x, q.y, 1.0);
    farthest = std::max(farthest, 1.05 * std::hypot(ray[0], ray[1]) / ray[2]);
  }
  max_tangent_ = std::min(farthest, max_tangent_);
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
  // Where a polynomial cannot be inverted, iterations end anywhere.
  const std::vector<cv::Point2d> back = distort(rectified);
  for (std::size_t i = 0; i < raw.size(); ++i) {
    if (!(cv::norm(back[i] - raw[i]) < kMaxReturn) || isBeyondPlane(raw[i]))
      rectified[i] = {kFarOutside, kFarOutside};
  }
  return rectified;
}

std::vector<cv::Point2f> CameraModel::unrectify(const std::vector<cv::Point2d>& rectified) const {
  std::vector<cv::Point2f> pixels;
  for (const cv::Point2d& raw : distort(rectified)) pixels.emplace_back(raw);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!parameters_.images_are_rectified && !shows(rectified[i]))
      pixels[i] = {static_cast<float>(kFarOutside), static_cast<float>(kFarOutside)};
  }
  return pixels;
}

std::vector<cv::Point2d> CameraModel::distort(const std::vector<cv::Point2d>& rectified) const {
  if (parameters_.images_are_rectified || rectified.empty()) return rectified;
  std::vector<cv::Point3d> rays;
  for (const auto& q : rectified) {
    const cv::Vec3d ray = raw_from_pixel_ * cv::Vec3d(q.x, q.y, 1.0);
    const bool is_ahead = ray[2] > 0.0;
    rays.emplace_back(is_ahead ? ray[0] / ray[2] : 0.0, is_ahead ? ray[1] / ray[2] : 0.0, 1.0);
  }
  std::vector<cv::Point2d> raw;
  const cv::Vec3d none(0.0, 0.0, 0.0);
  if (parameters_.distortion == Distortion::kEquidistant) {
    cv::fisheye::projectPoints(rays, raw, none, none, parameters_.K, parameters_.D);
  } else {
    cv::projectPoints(rays, none, none, parameters_.K, parameters_.D, raw);
  }
  return raw;
}

/// OpenCV mirrors what a fisheye sees behind the plane.
bool CameraModel::isBeyondPlane(const cv::Point2d& raw) const {
  if (parameters_.distortion != Distortion::kEquidistant) return false;
  const auto& D = parameters_.D;
  const auto& K = parameters_.K;
  const double theta = std::atan(1.1 * kMaxTangent), t = theta * theta;
  const double bent = theta * (1.0 + t * (D[0] + t * (D[1] + t * (D[2] + t * D[3]))));
  return std::hypot((raw.x - K(0, 2)) / K(0, 0), (raw.y - K(1, 2)) / K(1, 1)) > bent;
}

std::vector<double> CameraModel::magnifications(const std::vector<cv::Point2d>& rectified) const {
  const std::size_t n = rectified.size();
  std::vector<double> magnifications(n, 1.0);
  if (parameters_.images_are_rectified) return magnifications;
  std::vector<cv::Point2d> around; // half a pixel to each side
  for (const cv::Point2d& step : {cv::Point2d(-0.5, 0.0), {0.5, 0.0}, {0.0, -0.5}, {0.0, 0.5}}) {
    for (const cv::Point2d& pixel : rectified) around.push_back(pixel + step);
  }
  const auto raw = distort(around);
  for (std::size_t i = 0; i < n; ++i) {
    if (!shows(rectified[i])) continue;
    const cv::Point2d u = raw[n + i] - raw[i], v = raw[3 * n + i] - raw[2 * n + i];
    // Over the smaller singular value of (u v), whose product is their area.
    const double mean = 0.5 * (u.dot(u) + v.dot(v)), area = u.cross(v);
    const double larger = std::sqrt(mean + std::sqrt(std::max(0.0, mean * mean - area * area)));
    magnifications[i] = larger / std::abs(area);
  }
  return magnifications;
}

bool CameraModel::contains(const cv::Point2d& pixel) const {
  return pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x <= parameters_.size.width - 1 &&
         pixel.y <= parameters_.size.height - 1;
}

bool CameraModel::shows(const cv::Point2d& rectified) const {
  if (parameters_.images_are_rectified) return contains(rectified);
  const cv::Vec3d ray = raw_from_pixel_ * cv::Vec3d(rectified.x, rectified.y, 1.0);
  return ray[2] > 0.0 && std::hypot(ray[0], ray[1]) <= max_tangent_ * ray[2];
}

bool isRectified(const CameraModel::Parameters& p) {
  const bool undistorted = std::all_of(p.D.begin(), p.D.end(), [](double d) { return d == 0.0; }) &&
                           p.distortion == CameraModel::Distortion::kPolynomial;
  const bool same_lens = isClose(p.K, p.P, 1e-3) || isClose(p.K, cv::Matx33d::zeros(), 0.0); // not stated
  return undistorted && isClose(p.R, cv::Matx33d::eye(), 1e-9) && same_lens;
}

} // namespace vi_ekf_slam

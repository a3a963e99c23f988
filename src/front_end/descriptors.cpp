#include "vi_ekf_slam/front_end/descriptors.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>

namespace vi_ekf_slam {
namespace {

constexpr int kPatch = 31; // px
constexpr int kHalfPatch = kPatch / 2;

/// Direction in degrees from the centre of the patch to the centroid of its intensities. OpenCV computes it
/// for corners of its own alone.
float directionAt(const cv::Mat& image, const cv::Point2f& point) {
  const int x = cvRound(point.x), y = cvRound(point.y);
  int m10 = 0, m01 = 0;
  for (int v = -kHalfPatch; v <= kHalfPatch; ++v) {
    const int half = static_cast<int>(std::sqrt(static_cast<double>(kHalfPatch * kHalfPatch - v * v)));
    const auto* row = image.ptr<std::uint8_t>(std::clamp(y + v, 0, image.rows - 1));
    for (int u = -half; u <= half; ++u) {
      const int value = row[std::clamp(x + u, 0, image.cols - 1)];
      m10 += u * value;
      m01 += v * value;
    }
  }
  return cv::fastAtan2(static_cast<float>(m01), static_cast<float>(m10));
}

} // namespace

std::vector<Descriptor> describePoints(const cv::Mat& image, const std::vector<cv::Point2f>& points) {
  std::vector<cv::KeyPoint> keypoints;
  for (const auto& point : points) keypoints.emplace_back(point, kPatch, directionAt(image, point), 1.0f, 0);
  if (keypoints.empty()) return {};
  // No point is too near to the border: what lies beyond is mirrored.
  const auto orb = cv::ORB::create(1, 1.2f, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, kPatch);
  cv::Mat rows;
  orb->compute(image, keypoints, rows);
  std::vector<Descriptor> descriptors(points.size());
  CV_Assert(static_cast<std::size_t>(rows.rows) == points.size());
  for (int i = 0; i < rows.rows; ++i)
    std::copy_n(rows.ptr<std::uint8_t>(i), std::tuple_size_v<Descriptor>,
                descriptors[static_cast<std::size_t>(i)].begin());
  return descriptors;
}

} // namespace vi_ekf_slam

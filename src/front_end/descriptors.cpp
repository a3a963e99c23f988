#include "vi_ekf_slam/front_end/descriptors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>

namespace vi_ekf_slam {
namespace {

constexpr int kPatch = 31; // px
constexpr int kHalfPatch = kPatch / 2;

using HalfWidths = std::array<int, kPatch>;

/// px, of each row of a disc as large as the patch.
HalfWidths discHalfWidths() {
  HalfWidths widths{};
  for (int v = -kHalfPatch; v <= kHalfPatch; ++v) {
    widths[static_cast<std::size_t>(v + kHalfPatch)] =
        static_cast<int>(std::sqrt(static_cast<double>(kHalfPatch * kHalfPatch - v * v)));
  }
  return widths;
}

/// Beyond the image's border its last pixel goes on.
cv::Mat patchAround(const cv::Mat& image, const cv::Point& centre) {
  const cv::Rect all(centre.x - kHalfPatch, centre.y - kHalfPatch, kPatch, kPatch);
  const cv::Rect seen = all & cv::Rect({}, image.size());
  if (seen == all) return image(all);
  cv::Mat patch;
  cv::copyMakeBorder(image(seen), patch, seen.y - all.y, all.br().y - seen.br().y, seen.x - all.x,
                     all.br().x - seen.br().x, cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
  return patch;
}

/// Direction in degrees from the centre of the patch to the centroid of its intensities. OpenCV computes it
/// for corners of its own alone.
float directionAt(const cv::Mat& image, const cv::Point2f& point) {
  static const HalfWidths half_widths = discHalfWidths();
  const cv::Mat patch = patchAround(image, point);
  int m10 = 0, m01 = 0;
  for (int r = 0; r < kPatch; ++r) {
    const int half = half_widths[static_cast<std::size_t>(r)];
    const auto* middle = patch.ptr<std::uint8_t>(r) + kHalfPatch;
    int sum = 0;
    for (int u = -half; u <= half; ++u) {
      m10 += u * middle[u];
      sum += middle[u];
    }
    m01 += (r - kHalfPatch) * sum;
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

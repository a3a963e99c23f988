#include "vi_ekf_slam/front_end/descriptors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>

namespace vi_ekf_slam {
namespace {

constexpr int kPatch = 31; // px
constexpr int kHalfPatch = kPatch / 2;
// px from a point to what its descriptor depends on: ORB's pattern reaches to 18, what blurs it beforehand 3.
constexpr int kReach = 22, kAround = 2 * kReach + 1;

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

/// What is around the points, side by side; beyond the image's border it is mirrored.
cv::Mat patchesAround(const cv::Mat& image, const std::vector<cv::Point2f>& points) {
  cv::Mat patches(kAround, kAround * static_cast<int>(points.size()), CV_8UC1);
  cv::Rect place(0, 0, kAround, kAround);
  for (const cv::Point point : points) {
    const cv::Rect all(point - cv::Point(kReach, kReach), place.size());
    const cv::Rect seen = all & cv::Rect({}, image.size());
    cv::copyMakeBorder(image(seen), patches(place), seen.y - all.y, all.br().y - seen.br().y, seen.x - all.x,
                       all.br().x - seen.br().x, cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
    place.x += kAround;
  }
  return patches;
}

/// Direction in degrees from the centre of a patch to the centroid of its intensities. OpenCV computes it
/// for corners of its own alone.
float directionAt(const cv::Mat& image, const cv::Point& centre) {
  static const HalfWidths half_widths = discHalfWidths();
  int m10 = 0, m01 = 0;
  for (int r = 0; r < kPatch; ++r) {
    const int half = half_widths[static_cast<std::size_t>(r)];
    const auto* middle = image.ptr<std::uint8_t>(centre.y + r - kHalfPatch) + centre.x;
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
  if (points.empty()) return {};
  const cv::Mat patches = patchesAround(image, points); // the whole image would be blurred for some points
  std::vector<cv::KeyPoint> keypoints;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const cv::Point centre(static_cast<int>(i) * kAround + kReach, kReach);
    keypoints.emplace_back(centre, kPatch, directionAt(patches, centre), 1.0f, 0);
  }
  // No point is too near to the border of its patch.
  const auto orb = cv::ORB::create(1, 1.2f, 1, 0, 0, 2, cv::ORB::HARRIS_SCORE, kPatch);
  cv::Mat rows;
  orb->compute(patches, keypoints, rows);
  std::vector<Descriptor> descriptors(points.size());
  CV_Assert(static_cast<std::size_t>(rows.rows) == points.size());
  for (int i = 0; i < rows.rows; ++i)
    std::copy_n(rows.ptr<std::uint8_t>(i), std::tuple_size_v<Descriptor>,
                descriptors[static_cast<std::size_t>(i)].begin());
  return descriptors;
}

} // namespace vi_ekf_slam

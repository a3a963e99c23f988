#include "vi_ekf_slam/front_end/corner_detector.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "vi_ekf_slam/front_end/picture.hpp"

namespace vi_ekf_slam {
namespace {

constexpr int kRest = 12; // images
constexpr std::size_t kMostInCell = 3;
constexpr int kBlock = 7; // px, window of the structure tensor
constexpr int kCornerBorder = kWindow;
// A step of 4 grey levels a pixel in the direction in which it is least: with a noise of 2 and the window of
// the flow that is 0.04 px. The scale is that of cv::cornerMinEigenVal.
constexpr float kCornerMinEigenvalue = 4.0f * (4.0f / 255.0f) * (4.0f / 255.0f);

} // namespace

CornerDetector::CornerDetector(cv::Size image, std::size_t count) : image_(image), count_(count) {
  const double area = image.area() / static_cast<double>(std::max<std::size_t>(1, count));
  cell_ = std::max(2 * kBlock, static_cast<int>(std::sqrt(area)));
  grid_ = {(image.width + cell_ - 1) / cell_, (image.height + cell_ - 1) / cell_};
  rests_.assign(static_cast<std::size_t>(grid_.area()), 0);
}

std::size_t CornerDetector::cellOf(const cv::Point2f& point) const {
  const int x = std::clamp(static_cast<int>(point.x) / cell_, 0, grid_.width - 1);
  const int y = std::clamp(static_cast<int>(point.y) / cell_, 0, grid_.height - 1);
  return static_cast<std::size_t>(y * grid_.width + x);
}

void CornerDetector::noteFailure(const cv::Point2f& corner) { rests_[cellOf(corner)] = kRest; }

void CornerDetector::forgetFailures() { std::fill(rests_.begin(), rests_.end(), 0); }

std::vector<cv::Point2f> CornerDetector::detect(const cv::Mat& image,
                                                const std::vector<cv::Point2f>& occupied) {
  std::vector<cv::Point2f> corners;
  std::vector<std::vector<cv::Point2f>> points(rests_.size()); // of each cell, old and new
  for (const auto& p : occupied) points[cellOf(p)].push_back(p);
  const int radius = static_cast<int>(minDistance());
  const cv::Rect usable(kCornerBorder, kCornerBorder, image_.width - 2 * kCornerBorder,
                        image_.height - 2 * kCornerBorder);
  cv::Mat score;
  for (std::size_t held = 0; held < kMostInCell; ++held) {
    for (std::size_t index = 0; index < points.size(); ++index) {
      if (occupied.size() + corners.size() >= count_) break;
      if (points[index].size() != held || rests_[index] > 0) continue;
      const int gx = static_cast<int>(index) % grid_.width, gy = static_cast<int>(index) / grid_.width;
      const cv::Rect cell = cv::Rect(gx * cell_, gy * cell_, cell_, cell_) & usable;
      if (cell.area() == 0) continue;
      cv::cornerMinEigenVal(image(cell), score, kBlock); // looks beyond the cell by itself
      for (int y = std::max(0, gy - 1); y <= std::min(grid_.height - 1, gy + 1); ++y) {
        for (int x = std::max(0, gx - 1); x <= std::min(grid_.width - 1, gx + 1); ++x) {
          for (const auto& p : points[static_cast<std::size_t>(y * grid_.width + x)])
            cv::circle(score, cv::Point(p) - cell.tl(), radius, cv::Scalar(0.0), cv::FILLED);
        }
      }
      double best = 0.0;
      cv::Point where;
      cv::minMaxLoc(score, nullptr, &best, nullptr, &where);
      if (best < static_cast<double>(kCornerMinEigenvalue)) {
        rests_[index] = kRest;
        continue;
      }
      corners.emplace_back(where + cell.tl());
      points[index].push_back(corners.back());
    }
  }
  for (int& rest : rests_) rest = std::max(0, rest - 1);
  return corners;
}

} // namespace vi_ekf_slam

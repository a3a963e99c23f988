#include "vi_ekf_slam/front_end/track_drawing.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <sstream>

namespace vi_ekf_slam {
namespace {

constexpr double kOld = 2.0; // s
constexpr int kShift = 4;    // bits of a pixel's fraction that are drawn
const cv::Scalar kUnmatched(255, 160, 0), kText(0, 255, 255);

cv::Point fine(const cv::Point2f& p) { return p * static_cast<float>(1 << kShift); }

cv::Mat inColour(const cv::Mat& image, cv::Size size) {
  cv::Mat colour(size, CV_8UC3, cv::Scalar::all(0));
  if (image.type() == CV_8UC1 && image.size() == size) cv::cvtColor(image, colour, cv::COLOR_GRAY2BGR);
  return colour;
}

void dot(cv::Mat& image, const cv::Point2f& p, const cv::Scalar& colour) {
  cv::circle(image, fine(p), 3 << kShift, colour, 1, cv::LINE_AA, kShift);
}

} // namespace

cv::Mat drawTracks(const StereoImages& images, const FrontEnd& front_end) {
  const StereoCalibration& calibration = front_end.calibration();
  cv::Mat left = inColour(images.left, calibration.left.size());
  cv::Mat right = inColour(images.right, calibration.right.size());
  for (const Track& track : front_end.tracks()) {
    const double share = std::clamp(secondsBetween(track.begin, images.stamp) / kOld, 0.0, 1.0);
    const cv::Scalar colour = track.matched ? cv::Scalar(0, 255 * share, 255 * (1.0 - share)) : kUnmatched;
    if (track.begin != images.stamp)
      cv::line(left, fine(track.left_before), fine(track.left), colour, 1, cv::LINE_AA, kShift);
    dot(left, track.left, colour);
    if (track.matched) dot(right, track.right, colour);
  }
  const FrontEndReport& report = front_end.report();
  std::ostringstream text;
  text.precision(2);
  text << std::fixed << report.matched << " matched of " << front_end.tracks().size() << ", +" << report.begun
       << " -" << report.lost + report.rejected << ", life " << report.mean_life_s << " s";
  cv::Mat both;
  if (left.cols == right.cols) {
    cv::vconcat(left, right, both);
  } else {
    both = left;
  }
  const double scale = std::clamp(both.cols / 1000.0, 0.4, 1.5);
  cv::putText(both, text.str(), {8, cvRound(24 * scale)}, cv::FONT_HERSHEY_SIMPLEX, 0.8 * scale, kText, 1,
              cv::LINE_AA);
  const std::string problem = problemOf(report);
  if (!problem.empty())
    cv::putText(both, problem, {8, cvRound(56 * scale)}, cv::FONT_HERSHEY_SIMPLEX, 0.8 * scale,
                cv::Scalar(0, 0, 255), 1, cv::LINE_AA);
  return both;
}

} // namespace vi_ekf_slam

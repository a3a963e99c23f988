#include "vi_ekf_slam/front_end/flow.hpp"

#include <opencv2/video/tracking.hpp>

namespace vi_ekf_slam {
namespace {

const cv::TermCriteria kFlowIterations(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);
constexpr double kFlowMinEigenvalue = 1e-4; // OpenCV's own
constexpr float kFlowBorder = 0.5f * kWindow;

} // namespace

Flow followPoints(const Picture& from, const Picture& to, const std::vector<cv::Point2f>& points,
                  const std::vector<cv::Point2f>& guesses, int levels, float max_round_trip) {
  Flow flow;
  if (points.empty()) return flow;
  const cv::Size window(kWindow, kWindow);
  std::vector<uchar> forth, back;
  flow.points = guesses;
  cv::calcOpticalFlowPyrLK(from.pyramid, to.pyramid, points, flow.points, forth, cv::noArray(), window,
                           levels, kFlowIterations, cv::OPTFLOW_USE_INITIAL_FLOW, kFlowMinEigenvalue);
  std::vector<cv::Point2f> returned = points;
  cv::calcOpticalFlowPyrLK(to.pyramid, from.pyramid, flow.points, returned, back, cv::noArray(), window, 0,
                           kFlowIterations, cv::OPTFLOW_USE_INITIAL_FLOW, kFlowMinEigenvalue);
  const float right = static_cast<float>(to.image.cols - 1) - kFlowBorder;
  const float bottom = static_cast<float>(to.image.rows - 1) - kFlowBorder;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const cv::Point2f& p = flow.points[i];
    const auto round_trip = static_cast<float>(cv::norm(returned[i] - points[i]));
    flow.found.push_back(forth[i] != 0 && back[i] != 0 && round_trip <= max_round_trip &&
                         p.x >= kFlowBorder && p.y >= kFlowBorder && p.x <= right && p.y <= bottom);
  }
  return flow;
}

} // namespace vi_ekf_slam

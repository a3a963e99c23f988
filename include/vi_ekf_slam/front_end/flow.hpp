#pragma once

#include <vector>

#include "vi_ekf_slam/front_end/picture.hpp"

namespace vi_ekf_slam {

struct Flow {
  std::vector<cv::Point2f> points; ///< px in the second picture
  std::vector<bool> found;
};

/// Optical flow (pyramidal Lucas-Kanade) of `points` from one picture to another, beginning at `guesses`, and
/// the way back. Found is what comes back to within `max_round_trip` px, and lies half a window
/// within the picture.
Flow followPoints(const Picture& from, const Picture& to, const std::vector<cv::Point2f>& points,
                  const std::vector<cv::Point2f>& guesses, int levels, float max_round_trip);

} // namespace vi_ekf_slam

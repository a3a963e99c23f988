#pragma once

#include "vi_ekf_slam/front_end/front_end.hpp"

namespace vi_ekf_slam {

/// The last pair, left above right (bgr8): tracks from red (new) to green (2 s old) with their ways since the
/// pair before, the matches on the right, and the counts.
cv::Mat drawTracks(const StereoImages& images, const FrontEnd& front_end);

} // namespace vi_ekf_slam

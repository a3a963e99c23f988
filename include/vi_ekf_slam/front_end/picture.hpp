#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace vi_ekf_slam {

/// What is wrong with a picture.
enum class PictureFault { kNone, kWrongSize, kBlack, kOverexposed, kUniform, kPartlyUniform };

/// In words, for counts and diagnostics.
const char* describe(PictureFault fault);

/// Whether nothing can be tracked in it.
inline bool isUseless(PictureFault fault) {
  return fault != PictureFault::kNone && fault != PictureFault::kPartlyUniform;
}

/// One image (8 bit, one channel) with the pyramid that optical flow needs; built once, used with the image
/// before and the one after.
struct Picture {
  cv::Mat image;
  std::vector<cv::Mat> pyramid; ///< cv::buildOpticalFlowPyramid, with derivatives
  double brightness = 0.0;      ///< mean, 0 to 255
  PictureFault fault = PictureFault::kNone;
};

/// Side in px of the window that is compared, and levels above the image itself.
constexpr int kWindow = 15;
constexpr int kLevels = 2;

/// `size`: what the image must have.
Picture makePicture(const cv::Mat& image, cv::Size size);

} // namespace vi_ekf_slam

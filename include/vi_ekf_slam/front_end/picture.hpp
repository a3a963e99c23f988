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

constexpr double kDark = 40.0; ///< grey levels: what has less in the mean is dark

/// How bright a picture is and how much contrast it has: mean and standard deviation of its grey levels, 0 to
/// 255, coarse and without what is missing.
struct Light {
  double mean = 0.0, contrast = 0.0;
};

/// One image (8 bit, one channel) with the pyramid that optical flow needs; built once, used with the image
/// before and the one after.
struct Picture {
  cv::Mat image;
  cv::Mat thumbnail;            ///< block means; empty where the size is wrong
  std::vector<cv::Mat> pyramid; ///< cv::buildOpticalFlowPyramid, with derivatives
  Light light;
  PictureFault fault = PictureFault::kNone;
};

/// Side in px of the window that is compared, and levels above the image itself.
constexpr int kWindow = 15;
constexpr int kLevels = 2;

/// Looks at the image; `size`: what it must have.
Picture judgePicture(const cv::Mat& image, cv::Size size);
/// Gives a picture that is of use the light of others, which flow from one to the other takes for granted,
/// lifted where that is dim, and its pyramid.
void preparePicture(Picture& picture, const Light& light);

} // namespace vi_ekf_slam

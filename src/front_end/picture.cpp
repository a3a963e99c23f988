#include "vi_ekf_slam/front_end/picture.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

namespace vi_ekf_slam {
namespace {

constexpr int kThumbnail = 8;    // px of the image for one of the thumbnail that is judged; a power of 2
constexpr double kMissing = 0.3; // share of the picture
constexpr double kAll = 0.95;    // share
constexpr double kBright = 215.0;
constexpr int kSaturated = 250;
constexpr double kMaxGain = 4.0; // two stops; more would be noise
// Grey levels. What corners and patches must have at least is in grey levels too, and a dim drive has less.
constexpr double kLeastContrast = 35.0, kMiddle = 128.0;
constexpr double kMaxLift = 4.0;

/// Block means, by halves: for them alone resize() runs in vectors.
cv::Mat thumbnail(const cv::Mat& image) {
  cv::Mat small =
      image(cv::Rect(0, 0, image.cols / kThumbnail * kThumbnail, image.rows / kThumbnail * kThumbnail));
  for (int scale = kThumbnail; scale > 1; scale /= 2) {
    cv::Mat half;
    cv::resize(small, half, {}, 0.5, 0.5, cv::INTER_AREA);
    small = half;
  }
  return small;
}

/// What a lost part of a transmission, a covered lens or the sun make: neighbours that are exactly the same,
/// which the noise of a sensor never makes of block means that are not at an end of the scale.
PictureFault judge(const cv::Mat& small, Light& light) {
  const double brightness = cv::mean(small)[0];
  cv::Mat shown = cv::Mat::zeros(small.size(), CV_8UC1);
  int uniform = 0, saturated = 0;
  for (int y = 0; y + 1 < small.rows; ++y) {
    const auto* row = small.ptr<std::uint8_t>(y);
    const auto* below = small.ptr<std::uint8_t>(y + 1);
    for (int x = 0; x + 1 < small.cols; ++x) {
      const bool is_uniform = row[x] == row[x + 1] && row[x] == below[x] && row[x] == below[x + 1];
      uniform += is_uniform;
      shown.at<std::uint8_t>(y, x) = is_uniform ? 0 : 1;
      saturated += row[x] >= kSaturated;
    }
  }
  cv::Scalar mean, contrast;
  cv::meanStdDev(small, mean, contrast, shown);
  light = {mean[0], contrast[0]};
  const double cells = std::max(1, (small.rows - 1) * (small.cols - 1));
  if (uniform > kAll * cells && brightness < kDark) return PictureFault::kBlack;
  if (saturated > kAll * cells || (uniform > kAll * cells && brightness > kBright))
    return PictureFault::kOverexposed;
  if (uniform > kAll * cells) return PictureFault::kUniform;
  return uniform > kMissing * cells ? PictureFault::kPartlyUniform : PictureFault::kNone;
}

/// How much brighter pictures of that light are shown. An empty wall is not lifted: it has little contrast,
/// but is not dark.
double liftOf(const Light& light) {
  if (!(light.contrast > 0.0) || light.contrast >= kLeastContrast) return 1.0;
  const double to_middle = std::max(1.0, kMiddle / std::max(1.0, light.mean));
  return std::min({kMaxLift, kLeastContrast / light.contrast, to_middle});
}

} // namespace

const char* describe(PictureFault fault) {
  switch (fault) {
    case PictureFault::kNone:
      return "good";
    case PictureFault::kWrongSize:
      return "not of camera_info's size";
    case PictureFault::kBlack:
      return "black";
    case PictureFault::kOverexposed:
      return "overexposed";
    case PictureFault::kUniform:
      return "of one brightness";
    case PictureFault::kPartlyUniform:
      return "partly missing (of one brightness)";
  }
  return "";
}

Picture judgePicture(const cv::Mat& image, cv::Size size) {
  Picture picture;
  picture.image = image;
  if (image.type() != CV_8UC1 || image.size() != size) {
    picture.fault = PictureFault::kWrongSize;
    return picture;
  }
  picture.thumbnail = thumbnail(image);
  picture.fault = judge(picture.thumbnail, picture.light);
  return picture;
}

void preparePicture(Picture& picture, const Light& light) {
  const double equal = light.contrast > 0.0 && picture.light.contrast > 0.0
                           ? std::clamp(light.contrast / picture.light.contrast, 1.0 / kMaxGain, kMaxGain)
                           : 1.0;
  const double lift = liftOf(light), gain = lift * equal;
  // Not in place, since the image is somebody else's, and with the border that flow needs.
  const cv::Rect inside({kWindow, kWindow}, picture.image.size());
  cv::Mat bordered(cv::Size(inside.br() + inside.tl()), CV_8U), lit = bordered(inside);
  picture.image.convertTo(lit, CV_8U, gain, lift * light.mean - gain * picture.light.mean);
  cv::copyMakeBorder(lit, bordered, kWindow, kWindow, kWindow, kWindow,
                     cv::BORDER_REFLECT_101 | cv::BORDER_ISOLATED);
  picture.image = lit;
  cv::buildOpticalFlowPyramid(lit, picture.pyramid, cv::Size(kWindow, kWindow), kLevels, true,
                              cv::BORDER_REFLECT_101, cv::BORDER_CONSTANT, true);
}

} // namespace vi_ekf_slam

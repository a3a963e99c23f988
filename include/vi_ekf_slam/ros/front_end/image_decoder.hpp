#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>

namespace vi_ekf_slam {

/// Images of messages as 8-bit grey ones. Of 16-bit images the highest bits that are in use count, the same
/// ones in all that come after, or tracks would see the light change.
class ImageDecoder {
 public:
  /// mono8, mono16, bgr8, rgb8 and their relatives, Bayer, YUV; not copied where it is mono8: `message` must
  /// outlive what is returned. Throws std::exception, which names the encoding.
  cv::Mat decode(const sensor_msgs::ImageConstPtr& message);
  /// JPEG, PNG and what else OpenCV reads; of a Bayer mosaic, which the format names, the same grey as above.
  /// Throws std::exception.
  cv::Mat decode(const sensor_msgs::CompressedImage& message);
  cv::Mat decode(const sensor_msgs::CompressedImageConstPtr& message) { return decode(*message); }

 private:
  cv::Mat toEightBits(const cv::Mat& image);

  int bits_ = 8; ///< that are in use
};

} // namespace vi_ekf_slam

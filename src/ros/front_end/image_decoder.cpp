#include "vi_ekf_slam/ros/front_end/image_decoder.hpp"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <utility>

namespace vi_ekf_slam {

namespace encodings = sensor_msgs::image_encodings;

namespace {

constexpr const char* kYuy2 = "yuv422_yuy2"; // Y U Y V, of which cv_bridge knows nothing

cv::Mat read(const sensor_msgs::CompressedImage& message, int how) {
  const cv::Mat image = message.data.empty() ? cv::Mat() : cv::imdecode(message.data, how);
  if (image.empty() || (image.depth() != CV_8U && image.depth() != CV_16U))
    throw std::runtime_error("a compressed image that cannot be decoded, format '" + message.format + "'");
  return image;
}

/// cv_bridge says of others what it cannot convert, not what there may be.
void requireEncoding(const std::string& encoding) {
  if (encodings::isMono(encoding) || encodings::isColor(encoding) || encodings::isBayer(encoding) ||
      encoding == encodings::TYPE_8UC1 || encoding == encodings::TYPE_16UC1 ||
      encoding == encodings::YUV422 || encoding == kYuy2)
    return;
  throw std::runtime_error(
      "encoding is '" + encoding +
      "', allowed: mono8, mono16, bgr8, rgb8 (with alpha, with 16 bit), Bayer, yuv422, yuv422_yuy2");
}

/// cv_bridge makes of 16 bits in the other order of bytes an image of 8 bits, twice as wide.
sensor_msgs::ImageConstPtr inOurByteOrder(const sensor_msgs::ImageConstPtr& message) {
  constexpr bool kIsBigEndian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
  if (encodings::bitDepth(message->encoding) != 16 || (message->is_bigendian != 0) == kIsBigEndian)
    return message;
  auto swapped = boost::make_shared<sensor_msgs::Image>(*message);
  for (std::size_t i = 0; i + 1 < swapped->data.size(); i += 2)
    std::swap(swapped->data[i], swapped->data[i + 1]);
  swapped->is_bigendian = kIsBigEndian;
  return swapped;
}

cv::Mat greyOfYuy2(sensor_msgs::Image message) {
  message.encoding = encodings::TYPE_8UC2;
  cv::Mat grey;
  cv::extractChannel(cv_bridge::toCvCopy(message)->image, grey, 0);
  return grey;
}

/// The grey that a raw image of this encoding gives. JPEG has 8 bits whatever it was made of.
cv::Mat demosaic(const cv::Mat& mosaic, const std::string& encoding) {
  const bool is_deep = mosaic.depth() == CV_16U;
  const std::string pattern = encoding.substr(0, encoding.find_first_of("0123456789"));
  const auto image =
      boost::make_shared<cv_bridge::CvImage>(std_msgs::Header(), pattern + (is_deep ? "16" : "8"), mosaic);
  return cv_bridge::cvtColor(image, is_deep ? encodings::MONO16 : encodings::MONO8)->image;
}

} // namespace

cv::Mat ImageDecoder::toEightBits(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  double largest = 0.0;
  cv::minMaxLoc(image, nullptr, &largest);
  while (bits_ < 16 && largest >= std::exp2(bits_)) ++bits_;
  cv::Mat eight;
  image.convertTo(eight, CV_8U, 255.0 / (std::exp2(bits_) - 1.0));
  return eight;
}

cv::Mat ImageDecoder::decode(const sensor_msgs::ImageConstPtr& sent) {
  requireEncoding(sent->encoding);
  if (sent->encoding == kYuy2) return greyOfYuy2(*sent);
  const sensor_msgs::ImageConstPtr message = inOurByteOrder(sent);
  const std::string& encoding = message->encoding;
  const bool is_grey = encoding == encodings::MONO8 || encoding == encodings::TYPE_8UC1 ||
                       encoding == encodings::MONO16 || encoding == encodings::TYPE_16UC1;
  if (is_grey) return toEightBits(cv_bridge::toCvShare(message)->image);
  const bool is_deep = encodings::bitDepth(encoding) == 16;
  return toEightBits(cv_bridge::toCvShare(message, is_deep ? encodings::MONO16 : encodings::MONO8)->image);
}

cv::Mat ImageDecoder::decode(const sensor_msgs::CompressedImage& message) {
  // compressed_image_transport compresses the mosaic of Bayer as it is: "bayer_rggb8; jpeg compressed ".
  const std::string encoding = message.format.substr(0, message.format.find(';'));
  if (encodings::isBayer(encoding)) {
    const cv::Mat mosaic = read(message, cv::IMREAD_UNCHANGED);
    if (mosaic.channels() == 1) return toEightBits(demosaic(mosaic, encoding));
  }
  return toEightBits(read(message, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH));
}

} // namespace vi_ekf_slam

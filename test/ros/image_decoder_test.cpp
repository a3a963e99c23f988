#include "vi_ekf_slam/ros/front_end/image_decoder.hpp"

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace vi_ekf_slam {
namespace {

namespace encodings = sensor_msgs::image_encodings;

/// A grey ramp, 0 to 239 from left to right, in any encoding; `scale` for 16 bits.
sensor_msgs::ImageConstPtr ramp(const std::string& encoding, int scale = 1) {
  const bool is_deep = encodings::bitDepth(encoding) == 16;
  const int channels = encodings::numChannels(encoding);
  cv::Mat grey(48, 80, CV_16UC1);
  for (int v = 0; v < grey.rows; ++v)
    for (int u = 0; u < grey.cols; ++u)
      grey.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(3 * u * scale);
  if (!is_deep) grey.convertTo(grey, CV_8U);
  cv::Mat image;
  cv::merge(std::vector<cv::Mat>(static_cast<std::size_t>(channels), grey), image);
  const auto message = boost::make_shared<sensor_msgs::Image>();
  message->encoding = encoding;
  message->height = 48;
  message->width = 80;
  message->step = static_cast<std::uint32_t>(image.step);
  message->data.assign(image.data, image.data + image.step * 48);
  return message;
}

void expectRamp(const cv::Mat& image, double tolerance) {
  ASSERT_EQ(CV_8UC1, image.type());
  ASSERT_EQ(cv::Size(80, 48), image.size());
  for (int u = 2; u < 78; ++u) EXPECT_NEAR(3.0 * u, image.at<std::uint8_t>(20, u), tolerance) << u;
}

TEST(ImageDecoder, reads_every_encoding_of_cameras_as_the_same_grey) {
  for (const std::string& encoding :
       {encodings::MONO8, encodings::TYPE_8UC1, encodings::BGR8, encodings::RGB8, encodings::BGRA8,
        encodings::RGBA8, encodings::BAYER_RGGB8, encodings::BAYER_BGGR8, encodings::BAYER_GBRG8,
        encodings::BAYER_GRBG8}) {
    ImageDecoder decoder;
    SCOPED_TRACE(encoding);
    expectRamp(decoder.decode(ramp(encoding)), 4.0);
  }
}

TEST(ImageDecoder, scales_16_bits_by_those_that_are_in_use) {
  for (const std::string& encoding :
       {encodings::MONO16, encodings::TYPE_16UC1, encodings::BGR16, encodings::BAYER_RGGB16}) {
    SCOPED_TRACE(encoding);
    ImageDecoder twelve, sixteen;
    expectRamp(twelve.decode(ramp(encoding, 16)), 5.0);
    expectRamp(sixteen.decode(ramp(encoding, 256)), 5.0);
  }
}

TEST(ImageDecoder, reads_16_bits_in_either_order_of_bytes) {
  for (const std::string& encoding :
       {encodings::MONO16, encodings::TYPE_16UC1, encodings::BGR16, encodings::BAYER_RGGB16}) {
    SCOPED_TRACE(encoding);
    auto message = boost::make_shared<sensor_msgs::Image>(*ramp(encoding, 256));
    message->is_bigendian = 1;
    for (std::size_t i = 0; i < message->data.size(); i += 2)
      std::swap(message->data[i], message->data[i + 1]);
    expectRamp(ImageDecoder().decode(sensor_msgs::ImageConstPtr(message)), 5.0);
  }
}

TEST(ImageDecoder, reads_the_grey_of_yuv_in_either_order) {
  for (const bool is_yuy2 : {false, true}) {
    const auto message = boost::make_shared<sensor_msgs::Image>(*ramp("8UC2")); // of which U and V become 128
    message->encoding = is_yuy2 ? "yuv422_yuy2" : encodings::YUV422;
    for (std::size_t i = is_yuy2 ? 1 : 0; i < message->data.size(); i += 2) message->data[i] = 128;
    SCOPED_TRACE(message->encoding);
    expectRamp(ImageDecoder().decode(sensor_msgs::ImageConstPtr(message)), 1.0);
  }
}

TEST(ImageDecoder, keeps_its_scale_when_the_picture_gets_darker) {
  ImageDecoder decoder;
  decoder.decode(ramp(encodings::MONO16, 256));
  const cv::Mat dark = decoder.decode(ramp(encodings::MONO16, 16));
  EXPECT_NEAR(210.0 / 16.0, dark.at<std::uint8_t>(20, 70), 1.0);
}

TEST(ImageDecoder, does_not_copy_a_grey_image) {
  ImageDecoder decoder;
  const auto message = ramp(encodings::MONO8);
  EXPECT_EQ(message->data.data(), decoder.decode(message).data);
}

TEST(ImageDecoder, reads_compressed_images_of_8_and_16_bits) {
  ImageDecoder decoder;
  const auto grey = ramp(encodings::MONO8);
  const cv::Mat image(48, 80, CV_8UC1, const_cast<std::uint8_t*>(grey->data.data()));
  sensor_msgs::CompressedImage message;
  cv::imencode(".png", image, message.data);
  expectRamp(decoder.decode(message), 0.0);
  cv::imencode(".jpg", image, message.data);
  expectRamp(decoder.decode(message), 4.0);
  cv::Mat deep;
  image.convertTo(deep, CV_16U, 256.0);
  cv::imencode(".png", deep, message.data);
  expectRamp(decoder.decode(message), 5.0);
}

// compressed_image_transport compresses the mosaic, and the format names it.
TEST(ImageDecoder, makes_of_a_compressed_Bayer_mosaic_what_it_makes_of_a_raw_one) {
  const std::map<std::string, cv::Point> reds{
      {"bayer_rggb", {0, 0}}, {"bayer_bggr", {1, 1}}, {"bayer_gbrg", {0, 1}}, {"bayer_grbg", {1, 0}}};
  for (const auto& [pattern, red] : reds) {
    for (const int type : {CV_8UC1, CV_16UC1}) {
      const std::string encoding = pattern + (type == CV_8UC1 ? "8" : "16");
      SCOPED_TRACE(encoding);
      cv::Mat mosaic(48, 80, type);
      cv::RNG(1).fill(mosaic, cv::RNG::UNIFORM, 0, type == CV_8UC1 ? 256 : 4096);
      const auto raw = boost::make_shared<sensor_msgs::Image>(*ramp(encoding));
      raw->data.assign(mosaic.datastart, mosaic.dataend);
      ImageDecoder of_raw, of_compressed;
      sensor_msgs::CompressedImage message;
      message.format = encoding + "; png compressed ";
      cv::imencode(".png", mosaic, message.data);
      const cv::Mat expected = of_raw.decode(sensor_msgs::ImageConstPtr(raw));
      EXPECT_EQ(0.0, cv::norm(expected, of_compressed.decode(message), cv::NORM_INF));
    }
    // What is of one colour is of one grey then.
    cv::Mat mosaic(48, 80, CV_8UC1, cv::Scalar(40)), flat;
    for (int v = 0; v < 48; v += 2)
      for (int u = 0; u < 80; u += 2) mosaic.at<std::uint8_t>(cv::Point(u, v) + red) = 220;
    sensor_msgs::CompressedImage message;
    message.format = pattern + "8; jpeg compressed ";
    cv::imencode(".jpg", mosaic, message.data);
    const cv::Mat inside = ImageDecoder().decode(message)(cv::Rect(2, 2, 76, 44));
    cv::Scalar mean, deviation;
    cv::meanStdDev(inside, mean, deviation);
    EXPECT_LT(deviation[0], 3.0) << pattern;
  }
}

TEST(ImageDecoder, takes_no_mosaic_for_granted_where_colours_were_compressed) {
  const auto colours = ramp(encodings::BGR8);
  const cv::Mat image(48, 80, CV_8UC3, const_cast<std::uint8_t*>(colours->data.data()));
  sensor_msgs::CompressedImage message;
  message.format = "bayer_rggb8; png compressed bgr8";
  cv::imencode(".png", image, message.data);
  expectRamp(ImageDecoder().decode(message), 1.0);
}

TEST(ImageDecoder, names_what_it_cannot_read) {
  ImageDecoder decoder;
  const auto reason = [&decoder](const auto& message) {
    try {
      decoder.decode(message);
    } catch (const std::exception& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  sensor_msgs::CompressedImage compressed;
  compressed.format = "jpeg";
  EXPECT_NE("", reason(compressed));
  compressed.data = {1, 2, 3};
  EXPECT_EQ("a compressed image that cannot be decoded, format 'jpeg'", reason(compressed));
  auto image = boost::make_shared<sensor_msgs::Image>(*ramp(encodings::MONO8));
  image->encoding = "holo3";
  EXPECT_NE(std::string::npos, reason(sensor_msgs::ImageConstPtr(image)).find("holo3"));
  image->encoding = encodings::TYPE_32FC1;
  EXPECT_EQ(
      "encoding is '32FC1', allowed: mono8, mono16, bgr8, rgb8 (with alpha, with 16 bit), Bayer, yuv422, "
      "yuv422_yuy2",
      reason(sensor_msgs::ImageConstPtr(image)));
  image->encoding = encodings::MONO8;
  image->data.resize(10); // less than it announces
  EXPECT_NE("", reason(sensor_msgs::ImageConstPtr(image)));
}

} // namespace
} // namespace vi_ekf_slam

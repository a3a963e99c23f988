#include "vi_ekf_slam/ros/front_end/image_intake.hpp"

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>
#include <map>
#include <opencv2/imgproc.hpp>

namespace vi_ekf_slam {
namespace {

namespace encodings = sensor_msgs::image_encodings;

sensor_msgs::CameraInfo info(bool is_right) {
  sensor_msgs::CameraInfo m;
  m.header.frame_id = is_right ? "right_optical" : "left_optical";
  m.width = 640;
  m.height = 480;
  m.distortion_model = "plumb_bob";
  m.D = {0.0, 0.0, 0.0, 0.0, 0.0};
  m.K = {500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0};
  m.P = {500.0, 0.0, 320.0, is_right ? -250.0 : 0.0, 0.0, 510.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return m;
}

class Calibration : public testing::Test {
 protected:
  std::optional<StereoCalibration> make(ImageKind images = ImageKind::kAuto) {
    return stereoCalibration(left_, right_, images, topics_, problem_);
  }
  sensor_msgs::CameraInfo left_ = info(false), right_ = info(true);
  InputTopics topics_;
  std::string problem_;
};

TEST_F(Calibration, takes_images_as_rectified_where_D_R_K_and_P_say_so) {
  auto made = make();
  ASSERT_TRUE(made) << problem_;
  EXPECT_TRUE(made->left.imagesAreRectified() && made->right.imagesAreRectified());
  EXPECT_EQ(0.5, made->camera.baseline);
  left_.D[0] = -0.2;
  made = make();
  EXPECT_FALSE(made->left.imagesAreRectified());
  EXPECT_TRUE(made->right.imagesAreRectified());
  EXPECT_TRUE(make(ImageKind::kRectified)->left.imagesAreRectified()); // image_rect of image_proc
  EXPECT_FALSE(make(ImageKind::kRaw)->right.imagesAreRectified());
}

TEST_F(Calibration, knows_each_distortion_by_its_name) {
  left_.distortion_model = right_.distortion_model = "equidistant";
  left_.D = right_.D = {0.01, 0.0, 0.0, 0.0};
  ASSERT_TRUE(make()) << problem_;
  EXPECT_EQ(CameraModel::Distortion::kEquidistant, make()->left.parameters().distortion);
  left_.D.push_back(0.0); // as drivers of fisheyes fill it up
  ASSERT_TRUE(make()) << problem_;
  EXPECT_EQ(4u, make()->left.parameters().D.size());
  left_.D.back() = 0.1;
  EXPECT_FALSE(make());
  left_.distortion_model = right_.distortion_model = "rational_polynomial";
  left_.D = right_.D = {0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0};
  EXPECT_TRUE(make()) << problem_;
  left_.D.resize(14, 0.0);
  EXPECT_TRUE(make()) << problem_;
  right_.distortion_model = "thin_prism";
  EXPECT_FALSE(make());
  EXPECT_EQ(
      "right/camera_info: distortion_model is 'thin_prism', allowed: plumb_bob, rational_polynomial, "
      "equidistant",
      problem_);
  EXPECT_TRUE(make(ImageKind::kRectified)) << problem_;
  right_.distortion_model = "none"; // of a simulator
  right_.D.clear();
  EXPECT_FALSE(make());
  EXPECT_NE(std::string::npos,
            problem_.find("equidistant; empty where D is 0; any with front_end/images: rectified"));
}

TEST_F(Calibration, takes_what_is_not_stated_as_nothing_to_rectify) {
  left_.distortion_model.clear();
  left_.K.fill(0.0);
  ASSERT_TRUE(make()) << problem_;
  EXPECT_TRUE(make()->left.imagesAreRectified());
  left_.D[0] = -0.2;
  EXPECT_FALSE(make());
  EXPECT_NE(std::string::npos, problem_.find("left/camera_info: distortion_model is '', allowed: "));
  left_.distortion_model = "plumb_bob";
  EXPECT_FALSE(make());
  EXPECT_EQ("left/camera_info: focal lengths in K must be positive", problem_);
}

TEST_F(Calibration, names_a_size_that_nobody_gave) {
  left_.width = 0;
  EXPECT_FALSE(make());
  EXPECT_EQ("left/camera_info: width x height is 0 x 480, allowed: 61 to 16384 px", problem_);
}

TEST_F(Calibration, refuses_pictures_of_two_sizes) {
  left_.width = 752;
  left_.height = 480;
  right_.width = 376;
  right_.height = 240;
  EXPECT_FALSE(make());
  EXPECT_EQ(
      "left pictures are 752 x 480, right ones 376 x 240, allowed: the same size (scale one, with its K)",
      problem_);
}

TEST(PairCalibration, is_complete_with_both_cameras_and_the_way_to_the_IMU_and_stays_so) {
  PairCalibration calibration(ImageKind::kAuto, {}, "");
  for (const char* frame : {"imu", "another_imu"}) {
    std_msgs::Header header;
    header.frame_id = frame;
    calibration.addImu(header);
  }
  EXPECT_EQ("imu", calibration.imuFrame());
  EXPECT_EQ("no sensor_msgs/CameraInfo on left/camera_info", calibration.problem());
  calibration.addLeft(info(false));
  EXPECT_EQ("no sensor_msgs/CameraInfo on right/camera_info", calibration.problem());
  calibration.addRight(info(true));
  EXPECT_EQ("", calibration.problem());
  ASSERT_TRUE(calibration.cameras());
  EXPECT_EQ("left_optical", calibration.leftFrame());
  EXPECT_FALSE(calibration.cam_R_imu());
  tf2_msgs::TFMessage transforms;
  transforms.transforms.resize(1);
  transforms.transforms[0].header.frame_id = "imu";
  transforms.transforms[0].child_frame_id = "left_optical";
  transforms.transforms[0].transform.rotation.z = 1.0;
  calibration.addTransforms(transforms, true);
  ASSERT_TRUE(calibration.cam_R_imu());
  EXPECT_TRUE(calibration.cam_R_imu()->diagonal().isApprox(Eigen::Vector3d(-1.0, -1.0, 1.0)));
  for (const unsigned seconds : {1000U, 500U}) { // time jumps back, of a part that moves
    transforms.transforms[0].header.stamp = ros::Time(seconds, 0);
    transforms.transforms[0].child_frame_id = "arm";
    testing::internal::CaptureStderr();
    calibration.addTransforms(transforms, false);
    EXPECT_EQ("", testing::internal::GetCapturedStderr());
  }
  sensor_msgs::CameraInfo other = info(false);
  other.header.frame_id = "other";
  calibration.addLeft(other);
  EXPECT_EQ("left_optical", calibration.leftFrame());
}

class OfNoUse : public testing::Test {
 protected:
  OfNoUse() {
    images_.addLeftInfo(info(false));
    images_.addRightInfo(info(true));
    cv::Mat noise(480, 700, CV_8U);
    cv::RNG(4).fill(noise, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(noise, noise, {}, 2.0);
    cv::normalize(noise, noise, 20, 235, cv::NORM_MINMAX);
    noise_ = noise;
  }

  /// A wall 25 m away at pair k, past which the camera moves; `spoil` may change the message.
  template <typename Spoil>
  void send(int k, const Spoil& spoil) {
    for (const bool is_left : {true, false}) {
      const cv::Mat picture = noise_(cv::Rect((is_left ? 10 : 20) + k % 40, 0, 640, 480)).clone();
      auto message = boost::make_shared<sensor_msgs::Image>();
      message->header.stamp = ros::Time(1.0 + 0.1 * k);
      message->encoding = encodings::MONO8;
      message->height = 480;
      message->width = message->step = 640;
      message->data.assign(picture.datastart, picture.dataend);
      if (!spoil(*message, is_left)) continue;
      is_left ? images_.addLeft(sensor_msgs::ImageConstPtr(message))
              : images_.addRight(sensor_msgs::ImageConstPtr(message));
    }
    while (images_.processNext()) continue;
  }

  static InputTopics noImu() {
    InputTopics topics;
    topics.imu.clear();
    return topics;
  }

  cv::Mat noise_;
  std::uint64_t features_ = 0;
  ImageIntake images_{FullConfig(), noImu(),
                      [this](const StereoFeatureArray& f) { features_ += f.features.size(); }};
};

TEST_F(OfNoUse, a_part_that_is_missing_is_told_of_and_not_blamed) {
  for (int k = 0; k < 4; ++k) {
    send(k, [](sensor_msgs::Image& m, bool) {
      std::fill(m.data.begin(), m.data.begin() + 640 * 200, 255);
      return true;
    });
  }
  EXPECT_GT(features_, 100u);
  EXPECT_EQ("", images_.mostlyWrong());
  EXPECT_TRUE(images_.turnedAway().empty());
  EXPECT_EQ((std::map<std::string, std::uint64_t>{
                {"images used: left picture: partly missing (of one brightness)", 4}}),
            images_.flawed());
}

TEST_F(OfNoUse, an_encoding_that_cannot_be_decoded_is_the_one_cause) {
  for (int k = 0; k < 4; ++k) {
    send(k, [](sensor_msgs::Image& m, bool) {
      m.encoding = "8UC3";
      m.step *= 3;
      m.data.resize(3 * m.data.size());
      return true;
    });
  }
  EXPECT_NE(std::string::npos, images_.mostlyWrong().find("8UC3")) << images_.mostlyWrong();
  EXPECT_NE(std::string::npos, images_.lastProblem().find("8UC3"));
  for (const auto& [reason, count] : images_.turnedAway())
    EXPECT_NE(std::string::npos, reason.find("8UC3")) << reason << count;
}

TEST_F(OfNoUse, most_images_without_a_partner_are_named) {
  for (int k = 0; k <= 16; ++k)
    send(k, [k](sensor_msgs::Image&, bool is_left) { return is_left || k % 4 == 0; });
  EXPECT_EQ("images: left without a right one: 12 of 17", images_.mostlyWrong());
}

TEST_F(OfNoUse, a_camera_of_half_the_rate_is_not_blamed) {
  for (int k = 0; k <= 8; ++k)
    send(k, [k](sensor_msgs::Image&, bool is_left) { return is_left || k % 2 == 0; });
  EXPECT_EQ("", images_.mostlyWrong());
  EXPECT_EQ(4u, images_.turnedAway()["images: left without a right one"]);
}

TEST_F(OfNoUse, images_without_stamps_are_named) {
  for (int k = 0; k < 4; ++k) {
    send(k, [](sensor_msgs::Image& m, bool) {
      m.header.stamp = ros::Time();
      return true;
    });
  }
  EXPECT_EQ("their header.stamp is 0", images_.problem());
  EXPECT_EQ(8u, images_.turnedAway()["images: without a stamp"]);
}

TEST(PairCalibration, without_an_IMU_a_jump_back_of_time_is_no_cause_for_complaints) {
  PairCalibration calibration(ImageKind::kAuto, {}, "");
  tf2_msgs::TFMessage moving;
  moving.transforms.resize(1);
  moving.transforms[0].header.frame_id = "odom";
  moving.transforms[0].child_frame_id = "arm";
  moving.transforms[0].transform.rotation.w = 1.0;
  testing::internal::CaptureStderr();
  for (const unsigned seconds : {1000U, 500U}) {
    moving.transforms[0].header.stamp = ros::Time(seconds, 0);
    calibration.addTransforms(moving, false);
  }
  EXPECT_EQ("", testing::internal::GetCapturedStderr());
}

TEST(PairCalibration, has_the_IMU_frame_that_it_is_told) {
  PairCalibration calibration(ImageKind::kAuto, {}, "imu_link");
  std_msgs::Header header;
  header.frame_id = "imu";
  calibration.addImu(header);
  EXPECT_EQ("imu_link", calibration.imuFrame());
}

} // namespace
} // namespace vi_ekf_slam

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <set>
#include <string>

#include "slanted_plane.hpp"

/// Each picture that no camera should send: the front end says what is wrong, and goes on afterwards.
namespace vi_ekf_slam {
namespace {

class BadPictures : public testing::Test {
 protected:
  StereoImages look() {
    ++frame_;
    return wall_.look({Eigen::Matrix3d::Identity(), {0.01 * frame_, 0.0, 0.0}}, stamp());
  }
  Stamp stamp() const { return 5'000'000'000 + frame_ * 50'000'000LL; }

  /// A good pair, the bad one, and a good one again.
  template <typename Spoil>
  void expectSurvived(const Spoil& spoil, const std::string& problem) {
    front_end_.process(look());
    const auto before = ids();
    ASSERT_GT(before.size(), kCount / 2);
    StereoImages images = look();
    spoil(images);
    const StereoFrame bad = front_end_.process(images);
    EXPECT_NE(std::string::npos, problemOf(front_end_.report()).find(problem))
        << problemOf(front_end_.report());
    EXPECT_TRUE(bad.features.empty());
    const StereoFrame good = front_end_.process(look());
    EXPECT_EQ("", problemOf(front_end_.report()));
    EXPECT_GT(good.features.size(), kCount / 2);
    std::size_t same = 0;
    for (const FeatureId id : ids()) same += before.count(id);
    EXPECT_GT(same, before.size() * 7 / 10); // the tracks are bridged
  }

  std::set<FeatureId> ids() const {
    std::set<FeatureId> all;
    for (const Track& track : front_end_.tracks()) all.insert(track.id);
    return all;
  }

  SlantedPlane wall_{testCalibration()};
  FrontEnd front_end_{testCalibration(), {kCount}};
  int frame_ = 0;
};

TEST_F(BadPictures, black) {
  expectSurvived([](StereoImages& i) { i.left.setTo(3); }, "left picture: black");
  expectSurvived([](StereoImages& i) { i.right.setTo(0); }, "right picture: black");
}

TEST_F(BadPictures, overexposed) {
  expectSurvived([](StereoImages& i) { i.left.convertTo(i.left, -1, 1.0, 200.0); },
                 "left picture: overexposed");
}

TEST_F(BadPictures, a_sky_that_is_saturated_is_a_part_that_is_missing) {
  for (int k = 0; k < 5; ++k) {
    StereoImages images = look();
    for (cv::Mat* image : {&images.left, &images.right}) image->rowRange(0, 132).setTo(255);
    EXPECT_GT(front_end_.process(images).features.size(), kCount / 5);
    EXPECT_TRUE(wasUsed(front_end_.report()));
    EXPECT_EQ("left picture: partly missing (of one brightness)", problemOf(front_end_.report()));
  }
}

TEST(Rows, that_differ_tell_of_another_calibration) {
  const SlantedPlane wall(distortedCalibration(CameraModel::Distortion::kPolynomial));
  auto shifted = wall.calibration().right.parameters();
  shifted.K(1, 2) += 2.0;
  FrontEnd right(wall.calibration(), {2 * kCount});
  FrontEnd wrong({wall.calibration().left, CameraModel(shifted), wall.calibration().camera}, {2 * kCount});
  for (int k = 0; k < 5; ++k) {
    const StereoImages images =
        wall.look({Eigen::Matrix3d::Identity(), {0.01 * k, 0.0, 0.0}}, 50'000'000LL * (k + 100));
    right.process(images);
    EXPECT_EQ("", problemOf(right.report()));
    wrong.process(images);
    EXPECT_NE(std::string::npos,
              problemOf(wrong.report()).find("more than a quarter of the first points lie in different rows"))
        << problemOf(wrong.report());
  }
}

TEST_F(BadPictures, covered) {
  expectSurvived([](StereoImages& i) { i.right.setTo(120); }, "right picture: of one brightness");
}

TEST_F(BadPictures, of_another_size_or_type) {
  expectSurvived([](StereoImages& i) { cv::resize(i.left, i.left, {}, 0.5, 0.5); },
                 "not of camera_info's size");
  expectSurvived([](StereoImages& i) { i.right.convertTo(i.right, CV_16U); },
                 "right picture: not of camera_info's");
  expectSurvived([](StereoImages& i) { i.left = cv::Mat(); }, "left picture: not of camera_info's size");
}

TEST_F(BadPictures, half_missing) {
  front_end_.process(look());
  StereoImages images = look();
  images.left.rowRange(120, 240).setTo(0);
  const StereoFrame half = front_end_.process(images);
  EXPECT_EQ(PictureFault::kPartlyUniform, front_end_.report().left);
  EXPECT_NE(std::string::npos, problemOf(front_end_.report()).find("partly missing"));
  EXPECT_TRUE(wasUsed(front_end_.report()));
  EXPECT_GT(half.features.size(), kCount / 5);
  for (const auto& f : half.features) EXPECT_LT(f.pixels[1], 125.0);
  front_end_.process(look());
  EXPECT_GT(front_end_.process(look()).features.size(), kCount / 2);
}

TEST_F(BadPictures, blurred) {
  front_end_.process(look());
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    cv::GaussianBlur(images.left, images.left, {}, 10.0);
    cv::GaussianBlur(images.right, images.right, {}, 10.0);
    front_end_.process(images);
  }
  EXPECT_TRUE(front_end_.report().without_texture);
  EXPECT_NE(std::string::npos, problemOf(front_end_.report()).find("blurred"));
  for (int k = 0; k < 8; ++k) front_end_.process(look());
  EXPECT_EQ("", problemOf(front_end_.report()));
  EXPECT_GT(front_end_.report().matched, kCount / 2);
}

TEST_F(BadPictures, too_dark_to_follow_anything) {
  cv::RNG random(2);
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    for (cv::Mat* image : {&images.left, &images.right}) { // 5 to 20 levels, and noise
      cv::Mat levels(image->size(), CV_32F);
      random.fill(levels, cv::RNG::NORMAL, 0.0, 1.0);
      for (int u = 0; u < levels.cols; ++u) levels.col(u) += 5.0 + 15.0 * u / levels.cols;
      levels.convertTo(*image, CV_8U);
    }
    front_end_.process(images);
    EXPECT_NE(std::string::npos, problemOf(front_end_.report()).find(": dark, "))
        << problemOf(front_end_.report());
  }
}

TEST_F(BadPictures, left_and_right_exchanged) {
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    std::swap(images.left, images.right);
    EXPECT_LT(front_end_.process(images).features.size(), kCount / 10);
    EXPECT_TRUE(front_end_.report().exchanged);
  }
  EXPECT_EQ("left and right look exchanged", problemOf(front_end_.report()));
}

TEST_F(BadPictures, left_and_right_exchanged_of_which_a_part_is_missing) {
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    for (cv::Mat* image : {&images.left, &images.right}) image->rowRange(0, 100).setTo(0);
    std::swap(images.left, images.right);
    front_end_.process(images);
    EXPECT_EQ("left and right look exchanged; left picture: partly missing (of one brightness)",
              problemOf(front_end_.report()));
    EXPECT_FALSE(wasUsed(front_end_.report()));
  }
}

TEST_F(BadPictures, the_same_one_left_and_right) {
  expectSurvived([](StereoImages& i) { i.right = i.left.clone(); },
                 "left and right are the same picture, without disparity");
}

class RepeatedPictures : public BadPictures {
 protected:
  /// The features of ten pairs that show one and the same while the gyro tells this rate, rad/s.
  std::size_t repeat(double rate) {
    front_end_.setImuRotation(Eigen::Matrix3d::Identity());
    const StereoImages shown = look();
    std::size_t features = 0;
    for (int k = 0; k < 10; ++k, ++frame_) {
      front_end_.addImu({stamp() - 50'000'000, {0.0, rate, 0.0}, {}});
      front_end_.addImu({stamp(), {0.0, rate, 0.0}, {}});
      const StereoFrame frame = front_end_.process({stamp(), shown.left.clone(), shown.right.clone()});
      if (k > 0) features += frame.features.size();
    }
    return features;
  }
};

TEST_F(RepeatedPictures, are_of_no_use_while_the_gyro_turns) {
  EXPECT_EQ(0u, repeat(0.5));
  EXPECT_EQ("the same pictures as before, although the gyro turns (a camera that has stopped)",
            problemOf(front_end_.report()));
  EXPECT_FALSE(wasUsed(front_end_.report()));
  EXPECT_EQ(0u, repeat(0.5)); // of another one
  front_end_.process(look());
  EXPECT_EQ("", problemOf(front_end_.report()));
}

TEST_F(RepeatedPictures, of_one_camera_are_of_no_use_while_the_gyro_turns) {
  front_end_.setImuRotation(Eigen::Matrix3d::Identity());
  for (const bool is_left : {true, false}) {
    const StereoImages stopped = look();
    front_end_.process(stopped);
    for (int k = 0; k < 5; ++k) {
      StereoImages images = look();
      (is_left ? images.left : images.right) = (is_left ? stopped.left : stopped.right).clone();
      front_end_.addImu({stamp() - 50'000'000, {0.0, 0.5, 0.0}, {}});
      front_end_.addImu({stamp(), {0.0, 0.5, 0.0}, {}});
      EXPECT_TRUE(front_end_.process(images).features.empty());
      EXPECT_EQ(std::string("the same ") + (is_left ? "left" : "right") +
                    " picture as before, although the gyro turns (a camera that has stopped)",
                problemOf(front_end_.report()));
      EXPECT_FALSE(wasUsed(front_end_.report()));
    }
  }
}

TEST_F(RepeatedPictures, are_right_at_rest_whatever_the_bias_of_the_gyro) {
  EXPECT_GT(repeat(0.3), 9 * kCount / 2);
  EXPECT_EQ("", problemOf(front_end_.report()));
}

// Of which a filter would take the second one for a camera that stands still.
TEST_F(RepeatedPictures, that_are_sent_twice_are_of_no_use_without_a_gyro_too) {
  for (const bool both : {true, false}) {
    for (int k = 0; k < 5; ++k) {
      const StereoImages shown = look();
      EXPECT_GT(front_end_.process(shown).features.size(), kCount / 2);
      StereoImages again = look();
      if (both) again.left = shown.left.clone();
      again.right = shown.right.clone();
      EXPECT_TRUE(front_end_.process(again).features.empty());
      EXPECT_TRUE(front_end_.report().sent_twice);
      EXPECT_EQ(std::string("the same ") + (both ? "pictures" : "right picture") +
                    " as before, less than 0.2 s after the first of them (sent twice)",
                problemOf(front_end_.report()));
      EXPECT_FALSE(wasUsed(front_end_.report()));
    }
  }
}

TEST_F(BadPictures, left_and_right_exchanged_later_on) {
  front_end_.process(look());
  for (int k = 0; k < 20; ++k) { // tracks end meanwhile, and few corners are left to be tried
    StereoImages images = look();
    std::swap(images.left, images.right);
    front_end_.process(images);
    EXPECT_EQ("left and right look exchanged", problemOf(front_end_.report())) << k;
  }
  for (int k = 0; k < 10; ++k) front_end_.process(look());
  EXPECT_EQ("", problemOf(front_end_.report()));
  EXPECT_GT(front_end_.report().matched, kCount / 2);
}

// As a fence: each point is found on both sides, but looks most like what is where it should be.
TEST_F(BadPictures, of_repeated_texture_in_other_rows_do_not_look_exchanged) {
  const cv::Size size = testCalibration().left.size();
  cv::Mat tile(size.height, 48, CV_8U), fence, noise(size.height, size.width + 8, CV_8U);
  cv::RNG random(3);
  random.fill(tile, cv::RNG::UNIFORM, 0, 256);
  random.fill(noise, cv::RNG::UNIFORM, 0, 256);
  cv::repeat(tile, 1, noise.cols / tile.cols + 1, fence);
  fence = fence.colRange(0, noise.cols);
  for (cv::Mat* image : {&fence, &noise}) {
    cv::GaussianBlur(*image, *image, {}, 5.0);
    cv::normalize(*image, *image, 20, 235, cv::NORM_MINMAX);
  }
  cv::addWeighted(fence, 0.75, noise, 0.25, 0.0, fence);
  StereoImages images{stamp(), fence.colRange(0, size.width).clone(), cv::Mat()};
  images.right = cv::Mat(size, CV_8U);
  for (int v = 0; v < size.height; ++v) // 8 px to the left, 4 rows lower
    fence.row((v + size.height - 4) % size.height).colRange(8, size.width + 8).copyTo(images.right.row(v));
  front_end_.process(images);
  EXPECT_FALSE(front_end_.report().exchanged);
  EXPECT_EQ(0u, problemOf(front_end_.report()).find("hardly any point is found in the right picture"))
      << problemOf(front_end_.report());
  std::swap(images.left, images.right);
  images.stamp += 50'000'000;
  front_end_.process(images);
  EXPECT_TRUE(front_end_.report().exchanged);
}

TEST_F(BadPictures, that_OpenCV_fails_at_are_told_of) {
  StereoCalibration calibration = testCalibration();
  CameraModel::Parameters p = calibration.right.parameters();
  p.size.height -= 8;
  calibration.right = CameraModel(p);
  FrontEnd front_end(calibration, {kCount}); // which ImageIntake refuses
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    images.right = images.right.rowRange(0, p.size.height).clone();
    EXPECT_TRUE(front_end.process(images).features.empty());
    EXPECT_EQ(0u, problemOf(front_end.report()).find("OpenCV fails: ")) << problemOf(front_end.report());
    EXPECT_FALSE(wasUsed(front_end.report()));
    EXPECT_TRUE(front_end.tracks().empty());
  }
}

TEST_F(BadPictures, of_which_the_right_one_shows_something_else) {
  front_end_.process(look());
  int named = 0;
  for (int k = 0; k < 20; ++k) {
    StereoImages images = look();
    cv::flip(images.right, images.right, 0);
    EXPECT_LT(front_end_.process(images).features.size(), kCount / 10);
    EXPECT_FALSE(front_end_.report().exchanged);
    named += problemOf(front_end_.report()).find("hardly any point is found") == 0 ? 1 : 0;
  }
  EXPECT_GT(named, 5); // until hardly any corner is left that has not been tried
  EXPECT_NE("", problemOf(front_end_.report()));
}

TEST_F(BadPictures, a_stamp_that_does_not_advance_is_refused_and_a_jump_back_begins_anew) {
  front_end_.process(look());
  const auto before = ids();
  StereoImages images = look();
  images.stamp -= 50'000'000;
  EXPECT_TRUE(front_end_.process(images).features.empty());
  EXPECT_TRUE(front_end_.report().stamp_refused);
  EXPECT_EQ(before, ids());
  images.stamp -= 3'000'000'000;
  EXPECT_FALSE(front_end_.process(images).features.empty());
  EXPECT_TRUE(front_end_.report().begun_anew);
  for (const FeatureId id : ids()) EXPECT_EQ(0u, before.count(id)); // no id returns as another point
}

TEST_F(BadPictures, a_jump_back_into_other_light_is_seen_at_once) {
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    for (cv::Mat* image : {&images.left, &images.right}) *image *= 0.8;
    front_end_.process(images);
  }
  for (int k = 0; k < 3; ++k) {
    StereoImages images = look();
    images.stamp -= 60'000'000'000;
    EXPECT_GT(front_end_.process(images).features.size(), kCount / 2);
    EXPECT_EQ("", problemOf(front_end_.report()));
  }
}

TEST_F(BadPictures, tracks_do_not_outlive_a_long_gap) {
  front_end_.process(look());
  frame_ += 20;
  front_end_.process(look());
  EXPECT_TRUE(front_end_.report().begun_anew);
  EXPECT_EQ(0u, front_end_.report().followed);
}

TEST_F(BadPictures, so_slow_that_no_track_outlives_a_pair) {
  front_end_.process(look());
  EXPECT_EQ("", problemOf(front_end_.report()));
  for (int k = 0; k < 3; ++k) {
    frame_ += 10; // 0.55 s
    front_end_.process(look());
    EXPECT_NE(std::string::npos, problemOf(front_end_.report()).find("2 Hz"));
  }
  for (int k = 0; k < 15; ++k) { // as long, but for another reason
    StereoImages images = look();
    images.left.setTo(0);
    front_end_.process(images);
  }
  front_end_.process(look());
  EXPECT_EQ(0u, front_end_.report().followed);
  EXPECT_EQ("", problemOf(front_end_.report()));
}

} // namespace
} // namespace vi_ekf_slam

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "vi_ekf_slam/core/sensors/arrival_check.hpp"
#include "vi_ekf_slam/core/sensors/imu_check.hpp"
#include "vi_ekf_slam/core/sensors/stereo_check.hpp"

namespace vi_ekf_slam {
namespace {

/// What is said of 20 frames of 40 points, each changed by `change`, with the ids that idOf gives to (point,
/// frame).
template <typename Change, typename IdOf>
std::string saidOf(Change change, double sigma, IdOf idOf, double px_a_frame) {
  StereoCheck check;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0.0, sigma);
  std::uniform_real_distribution<double> pixel(50.0, 350.0);
  std::vector<StereoPixels> points(40);
  for (StereoPixels& p : points) {
    const double u = pixel(random), v = pixel(random);
    p << u + 20.0, v, u, v;
  }
  std::string said;
  for (int k = 0; k < 20; ++k) {
    StereoFrame frame;
    frame.stamp = fromSeconds(0.1 * k);
    for (int i = 0; i < 40; ++i) {
      StereoFeatureObservation feature;
      feature.id = static_cast<FeatureId>(idOf(i, k));
      feature.pixels = points[static_cast<std::size_t>(i)];
      for (int c = 0; c < 4; ++c) feature.pixels[c] += noise(random) + (c % 2 == 0 ? px_a_frame * k : 0.0);
      change(feature.pixels);
      frame.features.push_back(feature);
    }
    said += check.note(frame, 1.0);
  }
  EXPECT_EQ(said, check.problem()) << "it is said once";
  return said;
}
template <typename Change>
std::string saidOf(Change change, double sigma = 0.5) {
  return saidOf(
      change, sigma, [](int i, int) { return i; }, 3.0);
}

TEST(StereoCheck, SaysNothingOfARectifiedPair) {
  EXPECT_EQ(saidOf([](StereoPixels&) {}), "");
  EXPECT_EQ(saidOf([](StereoPixels&) {}, 1.0), "");
  EXPECT_EQ(saidOf([](StereoPixels& p) { p[0] = p[2] + 0.3; }), "") << "far points";
}

TEST(StereoCheck, NamesRowsThatDiffer) {
  const std::string said = saidOf([](StereoPixels& p) { p[3] += 4.0; });
  EXPECT_NE(said.find("matched points lie in different rows: "), std::string::npos) << said;
  EXPECT_NE(said.find("px (median of 400 points), allowed: 2.29 px"), std::string::npos) << said;
}

TEST(StereoCheck, NamesNoiseThatIsLargerThanStated) {
  EXPECT_EQ(saidOf([](StereoPixels&) {}, 1.1), "");
  const std::string said = saidOf([](StereoPixels&) {}, 1.5);
  EXPECT_NE(said.find("pixel noise is larger than stated: rows of matched points differ by "),
            std::string::npos)
      << said;
  EXPECT_NE(said.find("px makes them, stated: 1 px;"), std::string::npos) << said;
}

// Rows that differ by so much may be those of pictures that are not rectified, or noise.
TEST(StereoCheck, NamesNoiseThatIsFarLargerThanStatedToo) {
  const std::string said = saidOf([](StereoPixels&) {}, 3.0);
  EXPECT_EQ(said.find("matched points lie in different rows: "), 0u) << said;
  EXPECT_NE(said.find("camera_info; or their noise is 2.93 px, stated: 1 px ("), std::string::npos) << said;
}

TEST(StereoCheck, NamesSidesThatAreExchanged) {
  const std::string said = saidOf([](StereoPixels& p) { std::swap(p[0], p[2]); });
  EXPECT_NE(said.find("disparity has the wrong sign: 100 % of the points"), std::string::npos) << said;
}

// As of a detector whose points are not followed, and of one that counts them anew in each frame, in any
// order.
TEST(StereoCheck, NamesIdsThatFollowNoPoint) {
  const auto saidOfIds = [](auto idOf, double px_a_frame = 3.0) {
    return saidOf([](StereoPixels&) {}, 0.5, idOf, px_a_frame);
  };
  const std::string anew = saidOfIds([](int i, int k) { return 40 * k + i; });
  EXPECT_EQ(anew.find("ids do not last: 0 % of the points were in the frame before, allowed: at least 10 %"),
            0u)
      << anew;
  const std::string counted = saidOfIds([](int i, int k) { return (i * 7 + k * 11) % 40; });
  EXPECT_EQ(counted.find("ids do not follow points: against each other they move by "), 0u) << counted;
  EXPECT_EQ(saidOfIds([](int i, int k) { return i % 5 == k % 5 ? 1000 * k + i : i; }), "") << "some are lost";
  EXPECT_EQ(saidOfIds([](int i, int) { return i; }, 150.0), "") << "a fast turn";
}

TEST(StereoCheck, TakesNoNumbersThatAreNone) {
  EXPECT_EQ(saidOf([](StereoPixels& p) { p[1] = std::nan(""); }), "");
}

/// What is said of 10 s of an IMU at 100 Hz and features at 10 Hz that come so much after their stamps.
std::string saidOfDelays(double imu, double features) {
  ArrivalCheck check(0.2);
  std::string said;
  for (int k = 0; k < 1000; ++k) {
    const Stamp now = fromSeconds(0.01 * k);
    const double queue = k % 7 == 0 ? 0.5 : 0.0;
    said += check.note(Stream::kImu, now - fromSeconds(imu + queue), now);
    if (k % 10 == 0) said += check.note(Stream::kStereo, now - fromSeconds(features), now);
  }
  return said;
}

TEST(ArrivalCheck, NamesTheStreamThatIsLate) {
  EXPECT_EQ(saidOfDelays(0.002, 0.08), "");
  EXPECT_EQ(saidOfDelays(5.0, 5.1), "") << "a clock of their own, but one";
  EXPECT_NE(
      saidOfDelays(0.002, 0.5).find("features comes 0.498 s later after its stamp than imu, allowed: 0.2 s"),
      std::string::npos);
  EXPECT_NE(saidOfDelays(3.0, 0.0).find("imu comes 3 s later after its stamp than features"),
            std::string::npos);
}

// Whose driver starts again with another clock after a minute.
TEST(ArrivalCheck, NamesAStreamThatBecomesLate) {
  for (const double ahead : {0.0, 0.5}) {
    ArrivalCheck check(0.2);
    std::string said;
    for (int k = 0; k < 8000; ++k) {
      const Stamp now = fromSeconds(0.01 * k);
      said += check.note(Stream::kImu, now + fromSeconds(k > 6000 ? ahead : 0.0), now);
      // Once somebody pauses the recording, just after the IMU's first samples of a stretch.
      if (k % 10 == 0) said += check.note(Stream::kStereo, now - fromSeconds(k > 2020 && k < 2500), now);
    }
    EXPECT_EQ(said.find("features comes 0.5 s later after its stamp than imu"), ahead > 0.0 ? 0u : said.npos);
    EXPECT_EQ(said.rfind("features"), said.find("features")) << "once";
  }
}

// Whose features are heard from its second round on, since their connection takes longer.
TEST(ArrivalCheck, SaysNothingOfABagThatLoops) {
  ArrivalCheck check(0.2);
  std::string said;
  for (int k = 0; k < 1500; ++k) {
    const Stamp now = fromSeconds(0.01 * k), stamp = fromSeconds(0.01 * ((k + 280) % 300));
    said += check.note(Stream::kImu, stamp, now);
    if (k > 20 && k % 10 == 0) said += check.note(Stream::kStereo, stamp, now);
  }
  EXPECT_EQ(said, "");
}

/// What is said of a gyro that turns at this rate for 3 s.
std::string saidOfRate(double rate) {
  ImuCheck check(9.81);
  std::string said;
  check.onProblem([&said](const std::string& text) { said += text; });
  for (int k = 0; k < 300; ++k) {
    const ImuSample sample{
        fromSeconds(0.01 * k), Eigen::Vector3d(0.0, 0.0, rate), {}, Eigen::Vector3d(0, 0, 9.81), {}};
    check.arrived(sample.stamp);
    check.note(sample, true);
  }
  return said;
}

TEST(ImuCheck, NamesRatesThatNoGyroSays) {
  EXPECT_EQ(saidOfRate(20.0), "");
  EXPECT_EQ(saidOfRate(90.0),
            "the gyro's rates are up to 90 rad/s, allowed: 70 rad/s; is it in deg/s? it must be in rad/s");
}

} // namespace
} // namespace vi_ekf_slam

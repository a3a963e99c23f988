#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "../numeric.hpp"
#include "vi_ekf_slam/core/motion/standstill.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kStillPx = 0.3;

/// What a second of measurements shows, at 10 Hz.
struct LastSecond {
  double velocity_sigma = 0.5, gyro_sigma = 0.05; ///< m/s, rad/s, as the samples state them
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero(), rate = Eigen::Vector3d::Zero(); ///< m/s, rad/s, exact
  double bias_sigma = 0.0;                                                            ///< rad/s, of the gyro
  std::optional<double> flow = 0.1; ///< px from frame to frame; nothing: no picture
  std::size_t tracks = 20;
  double samples = 1.5; ///< s
};

Stamp at(double seconds) { return fromSeconds(100.0 + seconds); }

/// Features whose columns are `shift` px from where they began.
StereoFrame frameAt(double seconds, std::size_t tracks, double shift) {
  StereoFrame frame;
  frame.stamp = at(seconds);
  for (std::size_t i = 0; i < tracks; ++i) {
    const double u = 200.0 + 20.0 * static_cast<double>(i) + shift;
    frame.features.push_back({i, {u, 150.0, u - 30.0, 150.0}});
  }
  return frame;
}

StandstillDetector shown(const LastSecond& scene) {
  StandstillDetector detector(kStillPx);
  for (int i = 0; 0.1 * i <= scene.samples + 1e-9; ++i) {
    const double t = 0.1 * i;
    detector.addVelocity(at(t), scene.velocity, isotropic(scene.velocity_sigma));
    detector.addGyro(at(t), scene.rate, isotropic(scene.gyro_sigma), isotropic(scene.bias_sigma));
    if (scene.flow) detector.addFrame(frameAt(t, scene.tracks, *scene.flow * i));
  }
  return detector;
}

bool stands(const LastSecond& scene) { return shown(scene).stands(at(scene.samples)); }

TEST(StandstillDetector, TellsACarThatStands) {
  EXPECT_TRUE(stands({}));
  LastSecond noisy;
  noisy.velocity = {0.3, -0.2, 0.1}; // of a mean of 0.15 m/s standard deviation
  noisy.rate = {0.03, -0.02, 0.0};   // of 0.015 rad/s
  EXPECT_TRUE(stands(noisy));
}

TEST(StandstillDetector, TellsNothingBeforeItHasSeenMostOfASecond) {
  LastSecond scene;
  scene.samples = 0.7;
  EXPECT_FALSE(stands(scene));
  scene.samples = 0.9;
  EXPECT_TRUE(stands(scene));
  EXPECT_FALSE(StandstillDetector(kStillPx).stands(at(0.0)));
}

TEST(StandstillDetector, DoesNotTakeCreepingForStandingWhileThereIsAPicture) {
  LastSecond scene;
  scene.velocity = {0.2, 0.0, 0.0}; // below what a bad odometer tells
  scene.flow = 1.0;
  EXPECT_FALSE(stands(scene));
  scene.flow = 0.31;
  EXPECT_FALSE(stands(scene));
  scene.flow = 0.29;
  EXPECT_TRUE(stands(scene));
}

TEST(StandstillDetector, IsNotFooledByACarAheadThatMovesWithUs) {
  LastSecond scene; // the picture stands still
  scene.velocity = {8.0, 0.0, 0.0};
  EXPECT_FALSE(stands(scene));
  scene.velocity = {0.6, 0.0, 0.0};
  EXPECT_FALSE(stands(scene));
  scene.velocity = {0.0, 0.0, 0.0};
  scene.rate = {0.0, 0.0, 0.06};
  EXPECT_FALSE(stands(scene));
}

TEST(StandstillDetector, IsNotKeptFromItByACarThatCrosses) {
  StandstillDetector detector(kStillPx);
  for (int i = 0; i <= 15; ++i) {
    detector.addVelocity(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.5));
    detector.addGyro(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
    StereoFrame frame = frameAt(0.1 * i, 20, 0.0);
    for (std::size_t k = 0; k < 8; ++k) frame.features[k].pixels[0] += 5.0 * i; // fewer than half
    detector.addFrame(frame);
  }
  EXPECT_TRUE(detector.stands(at(1.5)));
}

TEST(StandstillDetector, TrustsNoBadOdometerAlone) {
  LastSecond scene;
  scene.flow.reset();
  EXPECT_FALSE(stands(scene));
  scene.velocity_sigma = 0.1;
  EXPECT_TRUE(stands(scene));
  scene.velocity = {0.08, 0.0, 0.0};
  EXPECT_TRUE(stands(scene));
  scene.velocity = {0.12, 0.0, 0.0};
  EXPECT_FALSE(stands(scene));
  // One just good enough allows for 0.14 m/s along each axis, and for 0.15 m/s in all.
  scene.velocity_sigma = 0.15;
  scene.velocity = {0.1, 0.1, 0.0};
  EXPECT_TRUE(stands(scene));
  scene.velocity = {0.12, 0.12, 0.0};
  EXPECT_FALSE(stands(scene));
}

TEST(StandstillDetector, TakesFewTracksForNoPicture) {
  LastSecond scene;
  scene.tracks = 4;
  EXPECT_FALSE(stands(scene));
  scene.tracks = 5;
  EXPECT_TRUE(stands(scene));
  // A car alone in the view cannot say that we move either, when the odometer is good.
  scene.tracks = 4;
  scene.flow = 5.0;
  scene.velocity_sigma = 0.1;
  EXPECT_TRUE(stands(scene));
}

TEST(StandstillDetector, AllowsForWhatIsNotKnownOfTheGyrosBias) {
  LastSecond scene;
  scene.gyro_sigma = 0.001;
  scene.rate = {0.0, 0.0, 0.02};
  EXPECT_FALSE(stands(scene));
  scene.bias_sigma = 0.01;
  EXPECT_TRUE(stands(scene));
}

TEST(StandstillDetector, TellsNothingWhereASensorIsSilent) {
  const StandstillDetector all = shown({});
  EXPECT_TRUE(all.stands(at(1.69)));
  EXPECT_FALSE(all.stands(at(1.71)));
  // After the gap the window has to fill again.
  StandstillDetector detector = all;
  for (int i = 30; i <= 45; ++i) {
    detector.addVelocity(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.5));
    detector.addGyro(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
    detector.addFrame(frameAt(0.1 * i, 20, 1.5)); // where the picture was left
    if (i != 38) {
      EXPECT_EQ(detector.stands(at(0.1 * i)), i > 38) << i;
    }
  }
  // Each sensor by itself.
  for (const bool gyro : {true, false}) {
    StandstillDetector one = all;
    for (int i = 16; i <= 20; ++i) {
      one.addFrame(frameAt(0.1 * i, 20, 1.5));
      if (gyro)
        one.addGyro(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
      else
        one.addVelocity(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.5));
    }
    EXPECT_FALSE(one.stands(at(2.0)));
  }
}

TEST(StandstillDetector, MovesOffWithTheCar) {
  StandstillDetector detector = shown({});
  ASSERT_TRUE(detector.stands(at(1.5)));
  detector.addVelocity(at(1.6), {1.0, 0.0, 0.0}, isotropic(0.5));
  detector.addGyro(at(1.6), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
  detector.addFrame(frameAt(1.6, 20, 1.5 + 0.5)); // the very first frame in which the picture moves
  EXPECT_FALSE(detector.stands(at(1.6)));
}

TEST(StandstillDetector, TellsACarThatHasStopped) {
  StandstillDetector detector(kStillPx);
  for (int i = 0; i <= 40; ++i) {
    const bool drives = i <= 20;
    const Eigen::Vector3d velocity(drives ? 5.0 : 0.0, 0.0, 0.0);
    detector.addVelocity(at(0.1 * i), velocity, isotropic(0.5));
    detector.addGyro(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
    detector.addFrame(frameAt(0.1 * i, 20, 10.0 * std::min(i, 20)));
    EXPECT_FALSE(i <= 25 && detector.stands(at(0.1 * i))) << i;
    EXPECT_TRUE(i <= 32 || detector.stands(at(0.1 * i))) << i;
  }
}

// At 30 Hz a car that creeps moves by a third of the pixels from frame to frame.
TEST(StandstillDetector, TellsTheSameWhateverTheRateOfThePictures) {
  for (const double rate : {5.0, 10.0, 30.0, 60.0}) {
    const auto standsAt = [rate](double px_per_second) {
      StandstillDetector detector(kStillPx);
      const int frames = static_cast<int>(1.5 * rate);
      for (int i = 0; i <= frames; ++i) {
        const double t = i / rate;
        detector.addVelocity(at(t), Eigen::Vector3d::Zero(), isotropic(0.5));
        detector.addGyro(at(t), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
        detector.addFrame(frameAt(t, 20, px_per_second * t));
      }
      return detector.stands(at(frames / rate));
    };
    EXPECT_TRUE(standsAt(0.2)) << rate;
    EXPECT_FALSE(standsAt(10.0)) << rate;
    EXPECT_FALSE(standsAt(4.0)) << rate;
  }
}

TEST(StandstillDetector, IgnoresPixelsThatAreNone) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto withNone = [&](std::size_t none) {
    StandstillDetector detector(kStillPx);
    for (int i = 0; i <= 15; ++i) {
      detector.addVelocity(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.5));
      detector.addGyro(at(0.1 * i), Eigen::Vector3d::Zero(), isotropic(0.05), Eigen::Matrix3d::Zero());
      StereoFrame frame = frameAt(0.1 * i, 20, 0.0);
      for (std::size_t k = 0; k < none; ++k) frame.features[k].pixels[static_cast<Eigen::Index>(k % 4)] = nan;
      detector.addFrame(frame);
    }
    return detector.stands(at(1.5));
  };
  EXPECT_TRUE(withNone(12));
  EXPECT_FALSE(withNone(20)); // no picture, and a bad odometer
}

} // namespace
} // namespace vi_ekf_slam::test

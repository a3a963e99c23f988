#include "vi_ekf_slam/core/invariant/standstill.hpp"

#include <algorithm>
#include <limits>
#include <optional>

#include "states.hpp"
#include "vi_ekf_slam/core/invariant/twist_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

constexpr double kStillPx = 0.3;

/// What a second of measurements shows, at 10 Hz.
struct Scene {
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

StandstillDetector shown(const Scene& scene) {
  StandstillDetector detector(kStillPx);
  for (int i = 0; 0.1 * i <= scene.samples + 1e-9; ++i) {
    const double t = 0.1 * i;
    detector.addVelocity(at(t), scene.velocity, isotropic(scene.velocity_sigma));
    detector.addGyro(at(t), scene.rate, isotropic(scene.gyro_sigma), isotropic(scene.bias_sigma));
    if (scene.flow) detector.addFrame(frameAt(t, scene.tracks, *scene.flow * i));
  }
  return detector;
}

bool stands(const Scene& scene) { return shown(scene).stands(at(scene.samples)); }

TEST(StandstillDetector, TellsACarThatStands) {
  EXPECT_TRUE(stands({}));
  Scene noisy;
  noisy.velocity = {0.3, -0.2, 0.1}; // of a mean of 0.15 m/s standard deviation
  noisy.rate = {0.03, -0.02, 0.0};   // of 0.015 rad/s
  EXPECT_TRUE(stands(noisy));
}

TEST(StandstillDetector, TellsNothingBeforeItHasSeenMostOfASecond) {
  Scene scene;
  scene.samples = 0.7;
  EXPECT_FALSE(stands(scene));
  scene.samples = 0.9;
  EXPECT_TRUE(stands(scene));
  EXPECT_FALSE(StandstillDetector(kStillPx).stands(at(0.0)));
}

TEST(StandstillDetector, DoesNotTakeCreepingForStandingWhileThereIsAPicture) {
  Scene scene;
  scene.velocity = {0.2, 0.0, 0.0}; // below what a bad odometer tells
  scene.flow = 1.0;
  EXPECT_FALSE(stands(scene));
  scene.flow = 0.31;
  EXPECT_FALSE(stands(scene));
  scene.flow = 0.29;
  EXPECT_TRUE(stands(scene));
}

TEST(StandstillDetector, IsNotFooledByACarAheadThatMovesWithUs) {
  Scene scene; // the picture stands still
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
  Scene scene;
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
  Scene scene;
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
  Scene scene;
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

TEST(MeasureStandstill, IsTheTextbooksUpdateByATwistOfZero) {
  Random random(40);
  Vector6d sigma;
  sigma << 0.02, 0.03, 0.04, 0.002, 0.003, 0.004;
  State state = busyState(random);
  const State before = state;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(6, state.size());
  H.middleCols<6>(kTwist).setIdentity();
  const Matrix6d noise = sigma.cwiseAbs2().asDiagonal();
  const Update update = updateOf(before, H, noise);
  State expected = before;
  ASSERT_TRUE(expected.apply(Correction(update.PHt, update.S, -before.twist())));
  measureStandstill(state, sigma);
  EXPECT_LT(relativeDistance(state.covariance(), expected.covariance()), 1e-9);
  EXPECT_LT(distance(state.twist(), expected.twist()), 1e-9);
  EXPECT_LT(distance(state.pose().matrix(), expected.pose().matrix()), 1e-9);
  // It stands now, and is known to.
  for (int i = 0; i < 6; ++i) {
    EXPECT_LE(std::sqrt(Eigen::MatrixXd(state.covariance())(kTwist + i, kTwist + i)), sigma[i]) << i;
  }
  expectCovariance(state);
}

TEST(MeasureStandstill, LetsASensorTellItsBias) {
  State state(kPrior);
  const Eigen::Vector3d bias(0.01, -0.02, 0.03);
  for (int i = 0; i < 200; ++i) {
    state.propagate(0.1, {kNoise.twist_density, Vector6d::Zero()});
    measureStandstill(state, Vector6d::Constant(1e-3));
    measureTwist(state, 3, bias, isotropic(0.01));
  }
  EXPECT_LT(distance(state.bias().tail<3>(), bias), 3e-4);
  EXPECT_LT(state.twist().norm(), 1e-3);
  // 200 samples of 0.01 rad/s beside a prior of 0.02 rad/s.
  const double sigma = std::sqrt(Eigen::MatrixXd(state.covariance())(kBias + 5, kBias + 5));
  EXPECT_NEAR(sigma, 1.0 / std::sqrt(200.0 / 1.01e-4 + 1.0 / 4e-4), 0.05 * sigma);
}

} // namespace
} // namespace vi_ekf_slam::invariant

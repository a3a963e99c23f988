#include "vi_ekf_slam/core/paper/models.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "../numeric.hpp"
#include "../street.hpp"
#include "reference.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::paper {
namespace {

using test::distance;
using test::exampleRig;
using test::numericJacobian;
using test::Random;
using test::relativeDistance;

/// U = imu_T_world with the covariance of its error.
struct InversePose {
  SE3 imu_T_world;
  Matrix6d covariance = Matrix6d::Zero();
};

void predict(const Vector6d& twist, double tau, const Matrix6d& W, InversePose& pose) {
  paper::predict(twist, tau, W, pose.imu_T_world, pose.covariance);
}

Vector6d randomTwist(Random& random) { return random.vector<6>(-2.0, 2.0); }

TEST(PaperPrediction, MeanIsTheMatrixExponentialOfEquation9) {
  Random random(1);
  for (const double tau : {0.0, 1e-9, 0.01, 0.1, 0.7}) {
    const Vector6d u = randomTwist(random);
    InversePose pose{SE3::Exp(randomTwist(random)), Matrix6d::Identity()};
    const test::Mat expected = test::expSeries(test::hat4((-tau * u).cast<long double>())) *
                               pose.imu_T_world.matrix().cast<long double>();
    predict(u, tau, Matrix6d::Zero(), pose);
    EXPECT_LT(distance(pose.imu_T_world.matrix(), expected), 1e-14);
  }
}

TEST(PaperPrediction, ErrorTransitionIsTheExponentialOfEquation10) {
  Random random(2);
  for (const double tau : {0.0, 1e-9, 0.01, 0.1, 0.7}) {
    const Vector6d u = randomTwist(random);
    const test::Mat expected = test::expSeries(test::curly6((-tau * u).cast<long double>()));
    EXPECT_LT(distance(errorTransition(u, tau), expected), 1e-14);
  }
}

TEST(PaperPrediction, ErrorTransitionIsTheNumericDerivativeOfTheMotion) {
  Random random(3);
  for (int i = 0; i < 20; ++i) {
    const Vector6d u = randomTwist(random);
    const double tau = random.uniform(0.01, 0.5);
    const SE3 U = SE3::Exp(randomTwist(random));
    InversePose mean{U, Matrix6d::Zero()};
    predict(u, tau, Matrix6d::Zero(), mean);
    const auto error_after = [&](const Vector6d& delta) {
      InversePose moved{SE3::Exp(delta) * U, Matrix6d::Zero()};
      predict(u, tau, Matrix6d::Zero(), moved);
      return (moved.imu_T_world * mean.imu_T_world.inverse()).Log();
    };
    EXPECT_LT(
        distance(errorTransition(u, tau), (numericJacobian<6, 6>(error_after, Vector6d::Zero().eval()))),
        1e-9);
  }
}

TEST(PaperPrediction, CovarianceIsEquation11) {
  Random random(4);
  for (int i = 0; i < 20; ++i) {
    const Vector6d u = randomTwist(random);
    const Matrix6d Sigma = random.covariance<6>(), W = random.covariance<6>();
    InversePose pose{SE3::Exp(randomTwist(random)), Sigma};
    predict(u, 0.1, W, pose);
    const test::Mat F = test::expSeries(test::curly6((-0.1 * u).cast<long double>()));
    const test::Mat expected = F * Sigma.cast<long double>() * F.transpose() + W.cast<long double>();
    EXPECT_LT(relativeDistance(pose.covariance, expected), 1e-14);
    EXPECT_EQ(distance(pose.covariance, pose.covariance.transpose()), 0.0);
  }
}

TEST(PaperPrediction, TwoStepsUnderOneTwistAreOneLongStep) {
  Random random(5);
  const Vector6d u = randomTwist(random);
  EXPECT_LT(distance(errorTransition(u, 0.3) * errorTransition(u, 0.2), errorTransition(u, 0.5)), 1e-14);
  InversePose once{SE3(), random.covariance<6>()}, twice = once;
  predict(u, 0.5, Matrix6d::Zero(), once);
  predict(u, 0.2, Matrix6d::Zero(), twice);
  predict(u, 0.3, Matrix6d::Zero(), twice);
  EXPECT_LT(distance(once.imu_T_world.matrix(), twice.imu_T_world.matrix()), 1e-14);
  EXPECT_LT(distance(once.covariance, twice.covariance), 1e-13);
}

TEST(PaperPrediction, NoTimeChangesNothing) {
  Random random(6);
  const InversePose before{SE3::Exp(randomTwist(random)), random.covariance<6>()};
  InversePose after = before;
  predict(randomTwist(random), 0.0, Matrix6d::Zero(), after);
  EXPECT_LT(distance(after.imu_T_world.matrix(), before.imu_T_world.matrix()), 1e-15);
  EXPECT_LT(distance(after.covariance, before.covariance), 1e-15);
}

/// A pose and a point that it sees.
struct View {
  SE3 imu_T_world;
  Eigen::Vector3d landmark_world;
};

View randomView(Random& random) {
  View view;
  view.imu_T_world = SE3::Exp(random.vector<6>(-1.5, 1.5));
  const Eigen::Vector3d p_imu(random.uniform(3.0, 30.0), random.uniform(-8.0, 8.0),
                              random.uniform(-3.0, 3.0));
  view.landmark_world = view.imu_T_world.inverse() * p_imu;
  return view;
}

TEST(PaperObservation, PixelsAreEquation16) {
  Random random(7);
  const StereoRig rig = exampleRig();
  for (int i = 0; i < 50; ++i) {
    const View view = randomView(random);
    const auto predicted = predictObservation(rig, view.imu_T_world, view.landmark_world, 0.5);
    ASSERT_TRUE(predicted);
    const test::Vec q = rig.cam_T_imu.matrix().cast<long double>() *
                        view.imu_T_world.matrix().cast<long double>() *
                        test::homogeneous(view.landmark_world.cast<long double>());
    EXPECT_LT(distance(predicted->pixels, test::calibration(rig.camera) * test::pi(q)), 1e-10);
  }
}

TEST(PaperObservation, ByLandmarkIsTheNumericDerivative) {
  Random random(8);
  const StereoRig rig = exampleRig();
  for (int i = 0; i < 50; ++i) {
    const View view = randomView(random);
    const auto pixels_of = [&](const Eigen::Vector3d& m) {
      return predictObservation(rig, view.imu_T_world, m, 0.5).value().pixels;
    };
    const auto numeric = numericJacobian<4, 3>(pixels_of, view.landmark_world);
    const auto predicted = predictObservation(rig, view.imu_T_world, view.landmark_world, 0.5);
    EXPECT_LT(relativeDistance(predicted->by_landmark, numeric), 1e-8);
  }
}

TEST(PaperObservation, ByPoseIsTheNumericDerivativeForALeftPerturbation) {
  Random random(9);
  const StereoRig rig = exampleRig();
  for (int i = 0; i < 50; ++i) {
    const View view = randomView(random);
    const auto pixels_of = [&](const Vector6d& delta) {
      return predictObservation(rig, SE3::Exp(delta) * view.imu_T_world, view.landmark_world, 0.5)
          .value()
          .pixels;
    };
    const auto numeric = numericJacobian<4, 6>(pixels_of, Vector6d::Zero().eval());
    const auto predicted = predictObservation(rig, view.imu_T_world, view.landmark_world, 0.5);
    EXPECT_LT(relativeDistance(predicted->by_pose, numeric), 1e-7);
  }
}

TEST(PaperObservation, JacobiansAreEquations15And19) {
  Random random(10);
  const StereoRig rig = exampleRig();
  const test::Mat M = test::calibration(rig.camera), oTi = rig.cam_T_imu.matrix().cast<long double>();
  for (int i = 0; i < 50; ++i) {
    const View view = randomView(random);
    const test::Mat U = view.imu_T_world.matrix().cast<long double>();
    const test::Vec m = test::homogeneous(view.landmark_world.cast<long double>());
    const test::Mat left = M * test::dpi(oTi * U * m) * oTi;
    const auto predicted = predictObservation(rig, view.imu_T_world, view.landmark_world, 0.5);
    EXPECT_LT(relativeDistance(predicted->by_landmark, (left * U).leftCols(3)), 1e-13);
    EXPECT_LT(relativeDistance(predicted->by_pose, left * test::odot4(U * m)), 1e-13);
  }
}

TEST(PaperObservation, NothingIsPredictedNearerThanMinDepthOrBehind) {
  const StereoRig rig = exampleRig();
  const auto at_depth = [&](double z) { return rig.cam_T_imu.inverse() * Eigen::Vector3d(0.1, 0.1, z); };
  EXPECT_TRUE(predictObservation(rig, SE3(), at_depth(0.51), 0.5));
  EXPECT_FALSE(predictObservation(rig, SE3(), at_depth(0.49), 0.5));
  EXPECT_FALSE(predictObservation(rig, SE3(), at_depth(0.0), 0.5));
  EXPECT_FALSE(predictObservation(rig, SE3(), at_depth(-10.0), 0.5));
  EXPECT_FALSE(predictObservation(rig, SE3(), Eigen::Vector3d::Constant(std::nan("")), 0.5));
}

TEST(PaperInitialisation, PutsTheLandmarkWhereEquations6To8Say) {
  Random random(11);
  const StereoRig rig = exampleRig();
  for (int i = 0; i < 50; ++i) {
    const View view = randomView(random);
    auto z = predictObservation(rig, view.imu_T_world, view.landmark_world, 0.5).value().pixels;
    const auto exact = initialLandmark(rig, view.imu_T_world, z, PaperConfig());
    ASSERT_TRUE(exact);
    EXPECT_LT(distance(*exact, view.landmark_world), 1e-9);
    z += random.vector<4>(-0.5, 0.5);
    const auto noisy = initialLandmark(rig, view.imu_T_world, z, PaperConfig());
    ASSERT_TRUE(noisy);
    const test::Mat U = view.imu_T_world.matrix().cast<long double>();
    EXPECT_LT(distance(*noisy, test::initialPoint(rig, U, z.cast<long double>())), 1e-10);
  }
}

TEST(PaperInitialisation, RefusesDepthsOutsideTheRangeAndBadPixels) {
  const StereoRig rig = exampleRig();
  PaperConfig config;
  config.min_depth_m = 1.0;
  config.max_depth_m = 20.0;
  const auto from_depth = [&](double z) {
    return initialLandmark(rig, SE3(), rig.camera.project({0.3, 0.1, z}), config);
  };
  EXPECT_FALSE(from_depth(0.99));
  EXPECT_TRUE(from_depth(1.01));
  EXPECT_TRUE(from_depth(19.9));
  EXPECT_FALSE(from_depth(20.1));
  EXPECT_FALSE(initialLandmark(rig, SE3(), {600.0, 180.0, 600.0, 180.0}, config));
  EXPECT_FALSE(initialLandmark(rig, SE3(), {-1.0, -1.0, -1.0, -1.0}, config));
  EXPECT_FALSE(initialLandmark(rig, SE3(), {600.0, std::nan(""), 550.0, 180.0}, config));
}

class Selection : public ::testing::TestWithParam<double> {};

TEST_P(Selection, KeepsTheStatedShareOfAnyConsecutiveIds) {
  const double fraction = GetParam();
  for (const FeatureId first : {0ULL, 7ULL, 123456ULL, 4000000000ULL}) {
    std::size_t kept = 0;
    for (FeatureId n = 1; n <= 3000; ++n) {
      kept += isSelected(first + n - 1, fraction) ? 1 : 0;
      ASSERT_LE(std::abs(static_cast<double>(kept) - fraction * static_cast<double>(n)), 1.0 + 1e-6)
          << "after " << n << " ids from " << first;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Fractions, Selection, ::testing::Values(1.0, 0.9, 0.5, 1.0 / 3.0, 0.1, 0.07, 0.01));

TEST(Selection, TakesOneOfAnyTenConsecutiveIdsAtATenth) {
  for (const FeatureId first : {0ULL, 3ULL, 99999ULL}) {
    std::size_t kept = 0;
    for (FeatureId id = first; id < first + 10; ++id) kept += isSelected(id, 0.1) ? 1 : 0;
    EXPECT_EQ(kept, 1U) << first;
  }
}

TEST(Selection, IsTheSameEveryTime) {
  for (FeatureId id = 0; id < 1000; ++id) EXPECT_EQ(isSelected(id, 0.1), isSelected(id, 0.1));
}

TEST(Selection, TakesEveryIdAtOneHoweverLargeTheId) {
  for (const FeatureId id : {FeatureId(0), FeatureId(1) << 52, (FeatureId(1) << 53) + 1, FeatureId(1) << 60,
                             std::numeric_limits<FeatureId>::max()}) {
    EXPECT_TRUE(isSelected(id, 1.0)) << id;
  }
}

TEST(Selection, KeepsTheShareOfIdsThatAreHashes) {
  std::mt19937_64 hash(12);
  std::size_t kept = 0;
  for (int i = 0; i < 10000; ++i) kept += isSelected(hash(), 0.1) ? 1 : 0;
  EXPECT_NEAR(static_cast<double>(kept), 1000.0, 150.0); // five standard deviations
}

} // namespace
} // namespace vi_ekf_slam::paper

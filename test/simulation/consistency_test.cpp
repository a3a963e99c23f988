#include "vi_ekf_slam/simulation/consistency.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {
namespace {

Vector6d normal6(Random& random) {
  Vector6d n;
  n << random.normal3(), random.normal3();
  return n;
}

/// A pose far from the origin, where the two conventions differ most.
SE3 farPose() { return SE3::Exp((Vector6d() << 120, -40, 6, 0.3, -0.2, 2.0).finished()); }

/// A covariance with strong correlations; standard deviations of `size` m and 0.01 `size` rad in order of
/// magnitude.
Matrix6d covariance(double size) {
  Random random(3, RandomStream::kMotion);
  Matrix6d A;
  for (int i = 0; i < 6; ++i) A.col(i) = normal6(random);
  A.bottomRows<3>() *= 0.01;
  return size * size * A * A.transpose();
}

/// Poses that really are wrong as `state` says, in its own convention: p = p^ + dp, R = Exp(dtheta) R^.
SE3 drawTruth(const StateEstimate& state, Random& random) {
  const Vector6d d = state.pose_covariance.llt().matrixL() * normal6(random);
  return {so3::Exp(d.tail<3>()) * state.world_T_imu.rotation(),
          state.world_T_imu.translation() + d.head<3>()};
}

PoseNees meanNees(const StateEstimate& state, int draws) {
  Random random(5, RandomStream::kScene);
  PoseNees mean;
  for (int i = 0; i < draws; ++i) {
    const PoseNees nees = poseNees(drawTruth(state, random), state);
    mean.pose += nees.pose / draws;
    mean.rotation += nees.rotation / draws;
    mean.position += nees.position / draws;
  }
  return mean;
}

TEST(InvariantError, IsTheLeftFactorOfTheTruth) {
  const Vector6d xi = (Vector6d() << 0.4, -0.2, 0.1, 0.02, -0.01, 0.05).finished();
  EXPECT_LT((invariantError(SE3::Exp(xi) * farPose(), farPose()) - xi).cwiseAbs().maxCoeff(), 1e-11);
}

TEST(InvariantCovariance, IsTheCovarianceOfTheInvariantError) {
  StateEstimate state;
  state.world_T_imu = farPose();
  // Column i of the Jacobian from (dp, dtheta) to xi, by differences.
  Matrix6d J;
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    const auto moved = [&](double h) {
      const Vector6d d = h * Vector6d::Unit(i);
      const SE3 truth(so3::Exp(d.tail<3>()) * farPose().rotation(), farPose().translation() + d.head<3>());
      return invariantError(truth, farPose());
    };
    J.col(i) = (moved(kStep) - moved(-kStep)) / (2.0 * kStep);
  }
  state.pose_covariance = covariance(0.5);
  const Matrix6d expected = J * state.pose_covariance * J.transpose();
  EXPECT_LT((invariantCovariance(state) - expected).cwiseAbs().maxCoeff(),
            1e-6 * expected.cwiseAbs().maxCoeff());
  // Guards the test: where the pose is, the conversion matters.
  EXPECT_GT((state.pose_covariance - expected).cwiseAbs().maxCoeff(), 0.1 * expected.cwiseAbs().maxCoeff());
}

TEST(PoseNees, MeanIsTheDegreesOfFreedomOfAnHonestCovariance) {
  StateEstimate state;
  state.world_T_imu = farPose();
  state.pose_covariance = covariance(0.05);
  constexpr int kDraws = 20000; // standard deviation of the mean: sqrt(12 / 20000) = 0.025
  const PoseNees honest = meanNees(state, kDraws);
  EXPECT_NEAR(honest.pose, 6.0, 0.1);
  EXPECT_NEAR(honest.rotation, 3.0, 0.07);
  EXPECT_NEAR(honest.position, 3.0, 0.07);
}

TEST(PoseNees, TellsAnOverconfidentCovariance) {
  StateEstimate drawn;
  drawn.world_T_imu = farPose();
  drawn.pose_covariance = covariance(0.05);
  Random random(7, RandomStream::kMotion);
  StateEstimate claimed = drawn;
  claimed.pose_covariance *= 0.25;
  double mean = 0.0;
  for (int i = 0; i < 2000; ++i) mean += poseNees(drawTruth(drawn, random), claimed).pose / 2000.0;
  EXPECT_NEAR(mean, 24.0, 1.5);
}

TEST(PoseNees, IsNotANumberWithoutAPositiveDefiniteCovariance) {
  StateEstimate state;
  EXPECT_TRUE(std::isnan(poseNees(SE3(), state).pose));
  state.pose_covariance = Matrix6d::Identity();
  state.pose_covariance(0, 1) = state.pose_covariance(1, 0) = 1.1;
  EXPECT_TRUE(std::isnan(poseNees(SE3(), state).pose));
  EXPECT_EQ(poseNees(SE3(), state).rotation, 0.0);
  state.pose_covariance(0, 1) = state.pose_covariance(1, 0) = 0.9;
  EXPECT_EQ(poseNees(SE3(), state).pose, 0.0);
}

TEST(AbsoluteTrajectoryError, IsWhatIsLeftAfterAnAlignment) {
  Random random(6, RandomStream::kMotion);
  const SE3 level(so3::Exp({0.0, 0.0, 2.0}), {120.0, -40.0, 6.0}), any = farPose();
  for (const bool is_level : {false, true}) {
    Eigen::Matrix3Xd truth(3, 4000), estimate(3, 4000), turned(3, 4000);
    for (Eigen::Index i = 0; i < truth.cols(); ++i) {
      truth.col(i) = 50.0 * random.normal3();
      estimate.col(i) = level * Eigen::Vector3d(truth.col(i));
      turned.col(i) = any * Eigen::Vector3d(truth.col(i));
    }
    EXPECT_NEAR(absoluteTrajectoryError(estimate, truth, is_level), 0.0, 1e-9);
    EXPECT_EQ(absoluteTrajectoryError(turned, truth, is_level) < 1e-9, !is_level);
    for (Eigen::Index i = 0; i < truth.cols(); ++i) estimate.col(i) += 0.2 * random.normal3();
    EXPECT_NEAR(absoluteTrajectoryError(estimate, truth, is_level), 0.2 * std::sqrt(3.0), 0.01);
    EXPECT_GT(absoluteTrajectoryError(1.01 * estimate, truth, is_level), 0.6); // the scale is not fitted
  }
}

// Tables of the chi-square distribution: 0.025 and 0.975 quantiles of 300, 48, 30 degrees of freedom.
TEST(ChiSquareMeanBounds, AreThoseOfTheTables) {
  const auto [low, high] = chiSquareMeanBounds(6.0, 50.0);
  EXPECT_NEAR(low, 253.912 / 50.0, 0.005);
  EXPECT_NEAR(high, 349.874 / 50.0, 0.005);
  EXPECT_NEAR(chiSquareMeanBounds(6.0, 8.0).first, 30.755 / 8.0, 0.01);
  EXPECT_NEAR(chiSquareMeanBounds(6.0, 8.0).second, 69.023 / 8.0, 0.01);
  EXPECT_NEAR(chiSquareMeanBounds(3.0, 10.0).first, 16.791 / 10.0, 0.01);
  EXPECT_NEAR(chiSquareMeanBounds(3.0, 10.0).second, 46.979 / 10.0, 0.01);
}

TEST(YawVarianceWatch, FindsAPlantedFallAndNothingElse) {
  YawVarianceWatch watch;
  Matrix6d P = Matrix6d::Identity();
  for (const double variance : {0.0, 1.0, 1.0, 1.5, 2.0}) {
    P(5, 5) = variance;
    P(3, 3) = P(4, 4) = P(0, 0) = 10.0 - variance; // the others may fall
    watch.add(P);
  }
  EXPECT_EQ(watch.largestFall(), 0.0);
  for (const double variance : {1.5, 3.0, 2.7}) {
    P(5, 5) = variance;
    watch.add(P);
  }
  EXPECT_DOUBLE_EQ(watch.largestFall(), 0.25); // 2.0 to 1.5, not 3.0 to 2.7
}

StereoFrame frameOf(std::initializer_list<FeatureId> ids) {
  StereoFrame frame;
  for (const FeatureId id : ids) frame.features.push_back({id, StereoPixels::Zero()});
  return frame;
}

TEST(ReturnWatch, TellsAGapFromAnEnd) {
  ReturnWatch watch;
  watch.add(frameOf({1, 2}));
  watch.add(frameOf({2, 3}));
  watch.add(frameOf({}));
  watch.add(frameOf({4}));
  watch.add(frameOf({4}));
  EXPECT_FALSE(watch.returned());
  watch.add(frameOf({4, 1}));
  EXPECT_TRUE(watch.returned());
}

} // namespace
} // namespace vi_ekf_slam::simulation

// Turns about the vertical, and what a map that points up leaves free.

#include <Eigen/Eigenvalues>
#include <cmath>

#include "../exp_series.hpp"
#include "../motion/inertial_core.hpp"
#include "vi_ekf_slam/core/filter/pose_reset.hpp"

namespace vi_ekf_slam::test {
namespace {

Eigen::Matrix3d aboutZ(double angle) { return so3::Exp({0.0, 0.0, angle}); }

/// A tilt: a turn about a horizontal axis.
Eigen::Matrix3d tiltOf(Random& random, double angle) {
  const double axis = random.uniform(-3.0, 3.0);
  return so3::Exp(angle * Eigen::Vector3d(std::cos(axis), std::sin(axis), 0.0));
}

// The integral over s of (1 - s) exp(s A) is the sum of A^k / (k + 2)!.
TEST(SecondIntegral, IsItsPowerSeries) {
  Random random(1);
  for (const double angle : {0.0, 1e-12, 1e-6, 1e-3, 0.01, 0.0999999, 0.1, 0.1000001, 0.5, 1.0, 3.0, 6.0}) {
    const Eigen::Vector3d phi = angle * random.direction();
    LongMatrix block = LongMatrix::Zero(9, 9);
    block.block<3, 3>(0, 0) = so3::hat(phi).cast<long double>();
    block.block<3, 3>(0, 3).setIdentity();
    block.block<3, 3>(3, 6).setIdentity();
    EXPECT_LT(distance(so3::secondIntegral(phi), expSeries(block).block<3, 3>(0, 6)), 1e-14) << angle;
  }
}

TEST(Heading, IsTheTurnAboutZOfATiltedBody) {
  Random random(2);
  for (const double tilt : {0.0, 1e-9, 0.3, 1.0, 3.0}) {
    for (double heading = -3.1; heading < 3.2; heading += 0.31) {
      const Eigen::Matrix3d R = aboutZ(heading) * tiltOf(random, tilt);
      EXPECT_NEAR(std::remainder(so3::heading(R) - heading, 2.0 * 3.14159265358979323846), 0.0, 1e-12)
          << tilt;
    }
  }
}

TEST(Levelled, KeepsPlaceAndTiltAndIsTheNearestTurn) {
  Random random(3);
  for (int run = 0; run < 50; ++run) {
    const SE3 pose(so3::Exp(random.vector<3>(-1.5, 1.5)), random.vector<3>(-9.0, 9.0));
    const SE3 like(so3::Exp(random.vector<3>(-1.5, 1.5)), random.vector<3>(-9.0, 9.0));
    const SE3 level = levelled(pose, like);
    EXPECT_EQ(level.translation(), pose.translation());
    EXPECT_LT(distance(level.rotation().row(2), like.rotation().row(2)), 1e-14);
    const auto angle = [&](const Eigen::Matrix3d& R) {
      return so3::Log(R.transpose() * pose.rotation()).norm();
    };
    for (const double turn : {-0.3, -0.01, 0.01, 0.3, 3.0})
      EXPECT_LE(angle(level.rotation()), angle(aboutZ(turn) * level.rotation()) + 1e-12);
  }
  // A pose of the same tilt is what it is.
  const Eigen::Matrix3d tilt = tiltOf(random, 0.4);
  const SE3 pose(aboutZ(1.0) * tilt, {1.0, 2.0, 3.0}), like(aboutZ(-2.0) * tilt, {0.0, 0.0, 0.0});
  EXPECT_LT(distance(levelled(pose, like).matrix(), pose.matrix()), 1e-14);
}

TEST(LevelFilter, IsOneWithAVelocityInTheWorld) {
  Random random(4);
  EXPECT_TRUE(InertialScene().filter.isLevel());
  EXPECT_FALSE(busyScene(random).filter.isLevel());
}

TEST(LevelFilter, APoseResetTurnsTheVelocityWithTheBody) {
  Random random(5);
  InertialScene scene = randomInertial(random);
  scene.filter.setCoreCovariance(randomCovariance(random, 15, 0.01));
  const Inertial& motion = scene.motion;
  const ImuTrack imu({}, true);
  const Vector6d twist = motion.twist(scene.filter, imu, 0);
  const Eigen::MatrixXd P = motion.twistCovariance(scene.filter, imu);
  resetPose(scene.filter, SE3::Exp(random.vector<6>(-1.0, 1.0)), 0.01 * random.covariance<6>());
  EXPECT_LT(distance(motion.twist(scene.filter, imu, 0), twist), 1e-12);
  EXPECT_LT(distance(motion.twistCovariance(scene.filter, imu), P), 1e-12);
  expectCovariance(scene.filter.covariance());
}

TEST(LevelFilter, IsToldWhereItIsAndHeadsAndNotItsTilt) {
  Random random(6);
  InertialScene scene = randomInertial(random);
  scene.filter.setCoreCovariance(randomCovariance(random, 15, 1e-3));
  const Eigen::Matrix3d before = scene.filter.pose().rotation();
  const Eigen::Matrix2d tilt = scene.filter.covariance().block<2, 2>(3, 3);
  const Matrix6d known = 0.01 * Matrix6d::Identity();
  const SE3 told(so3::Exp(random.vector<3>(-1.0, 1.0)), random.vector<3>(-9.0, 9.0));
  ASSERT_TRUE(tellPose(scene.filter, told, known));
  EXPECT_LT(distance(scene.filter.pose().translation(), told.translation()), 1e-9);
  EXPECT_LT(distance(scene.filter.pose().rotation(), levelled(told, {before, {}}).rotation()), 1e-9);
  const Eigen::MatrixXd P = scene.filter.covariance();
  EXPECT_LT(relativeDistance(P.topLeftCorner<3, 3>(), known.topLeftCorner<3, 3>()), 1e-3);
  EXPECT_NEAR(P(5, 5), 0.01, 1e-4);
  // The heading has been learned beside the tilt, with which it was correlated: that is known as well as
  // before.
  EXPECT_LE((P.block<2, 2>(3, 3) - tilt).selfadjointView<Eigen::Lower>().eigenvalues().maxCoeff(), 1e-9);
  EXPECT_GT(P(3, 3), 0.5 * tilt(0, 0));
}

TEST(LevelFilter, AFixedCoordinateIsKnownAndCorrelatedWithNothing) {
  Random random(7);
  InertialScene scene = randomInertial(random);
  const Eigen::MatrixXd P = randomCovariance(random, 15, 0.1);
  scene.filter.setCoreCovariance(P);
  Eigen::MatrixXd expected = P;
  for (const Eigen::Index row : {0, 5}) {
    scene.filter.makeIndependent(row, Eigen::Matrix<double, 1, 1>(1e-6));
    expected.row(row).setZero();
    expected.col(row).setZero();
    expected(row, row) = 1e-6;
  }
  EXPECT_EQ(distance(scene.filter.covariance(), expected), 0.0);
  expectCovariance(scene.filter.covariance());
}

} // namespace
} // namespace vi_ekf_slam::test

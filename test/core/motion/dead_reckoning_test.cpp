#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "../numeric.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

using test::distance;
using test::Random;

ImuSample gyro(double t, const Eigen::Vector3d& omega) { return {fromSeconds(t), omega, {}}; }
VelocitySample velocity(double t, const Eigen::Vector3d& v) { return {fromSeconds(t), v, {}}; }

Vector6d twist(const Eigen::Vector3d& v, const Eigen::Vector3d& omega) {
  Vector6d u;
  u << v, omega;
  return u;
}

TEST(DeadReckoning, StartsAtTheIdentityAtRestWithoutAClock) {
  const DeadReckoning dr;
  EXPECT_EQ(distance(dr.pose().matrix(), Eigen::Matrix4d::Identity()), 0.0);
  EXPECT_EQ(dr.twist().norm(), 0.0);
  EXPECT_FALSE(dr.stamp());
}

TEST(DeadReckoning, TheFirstMeasurementStartsTheClockWithoutMotion) {
  DeadReckoning dr;
  dr.process(velocity(1000.0, {50.0, 0.0, 0.0}));
  EXPECT_EQ(distance(dr.pose().matrix(), Eigen::Matrix4d::Identity()), 0.0);
  EXPECT_EQ(dr.stamp(), fromSeconds(1000.0));
}

TEST(DeadReckoning, ConstantTwistGivesTheExactArcWhateverTheSteps) {
  const double speed = 3.0, rate = 0.5;
  Random random(1);
  DeadReckoning dr;
  dr.process(gyro(0.0, {0.0, 0.0, rate}));
  dr.process(velocity(0.0, {speed, 0.0, 0.0}));
  double t = 0.0;
  while (t < 20.0) {
    t += random.uniform(0.001, 0.4); // big steps too: the integration is exact, not Euler
    if (random.uniform(0.0, 1.0) < 0.5) {
      dr.process(gyro(t, {0.0, 0.0, rate}));
    } else {
      dr.process(velocity(t, {speed, 0.0, 0.0}));
    }
    const double elapsed = secondsBetween(0, *dr.stamp()), angle = rate * elapsed;
    const Eigen::Vector3d arc(speed / rate * std::sin(angle), speed / rate * (1.0 - std::cos(angle)), 0.0);
    ASSERT_LT(distance(dr.pose().translation(), arc), 1e-11) << t;
    ASSERT_LT(distance(dr.pose().rotation(), so3::Exp({0.0, 0.0, angle})), 1e-12) << t;
  }
}

TEST(DeadReckoning, EachSampleIsHeldUntilTheNextOfItsOwnSensor) {
  const Eigen::Vector3d w1(0.1, 0.2, 0.3), w2(-0.3, 0.1, 0.0), v1(1.0, 0.0, 0.2), v2(0.5, -0.5, 0.0);
  DeadReckoning dr;
  dr.process(gyro(0.0, w1));
  dr.process(velocity(0.03, v1));
  dr.process(gyro(0.1, w2));
  dr.process(velocity(0.25, v2));
  dr.advanceTo(fromSeconds(0.4));
  const Eigen::Vector3d rest = Eigen::Vector3d::Zero();
  const SE3 expected = SE3::Exp(0.03 * twist(rest, w1)) * SE3::Exp(0.07 * twist(v1, w1)) *
                       SE3::Exp(0.15 * twist(v1, w2)) * SE3::Exp(0.15 * twist(v2, w2));
  EXPECT_LT(distance(dr.pose().matrix(), expected.matrix()), 1e-14);
  EXPECT_EQ(distance(dr.twist(), twist(v2, w2)), 0.0);
  EXPECT_EQ(dr.stamp(), fromSeconds(0.4));
}

TEST(DeadReckoning, EqualStampsMoveNothingAndTheirOrderDoesNotMatter) {
  DeadReckoning first, second;
  for (int i = 0; i < 10; ++i) {
    const double t = 0.1 * i;
    const Eigen::Vector3d w(0.1 * i, 0.2, -0.1), v(1.0, 0.1 * i, 0.0);
    const SE3 before = i == 0 ? SE3() : first.pose();
    first.process(gyro(t, w));
    const SE3 between = first.pose();
    first.process(velocity(t, v));
    EXPECT_EQ(distance(first.pose().matrix(), between.matrix()), 0.0);
    if (i > 1) {
      EXPECT_GT(distance(first.pose().matrix(), before.matrix()), 1e-3);
    }
    second.process(velocity(t, v));
    second.process(gyro(t, w));
    second.advanceTo(fromSeconds(t));
    EXPECT_EQ(distance(first.pose().matrix(), second.pose().matrix()), 0.0);
  }
}

TEST(DeadReckoning, StaysARotationOverAMillionSteps) {
  DeadReckoning dr;
  dr.process(velocity(0.0, {1.0, 0.2, 0.0}));
  dr.process(gyro(0.0, {0.3, -0.7, 1.1}));
  for (Stamp i = 1; i <= 1000000; ++i) dr.advanceTo(i * 1000000);
  EXPECT_TRUE(so3::isRotation(dr.pose().rotation(), 1e-14));
  const SE3 expected = SE3::Exp(1000.0 * dr.twist());
  EXPECT_LT(distance(dr.pose().matrix(), expected.matrix()), 1e-7);
}

} // namespace
} // namespace vi_ekf_slam

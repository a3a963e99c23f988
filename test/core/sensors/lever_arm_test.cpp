#include "vi_ekf_slam/core/sensors/lever_arm.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

const Eigen::Vector3d kArm(0.5, -0.3, 1.0), kRate(0.1, -0.2, 0.4);

TEST(LeverArm, leaves_the_velocity_of_the_imu_as_it_is) {
  LeverArm arm(0.1, 0.01);
  arm.note({1, kRate, {}});
  const VelocitySample same = arm.atImu({2, {1.0, 2.0, 3.0}, {}, Eigen::Vector3d::Zero()});
  EXPECT_EQ(Eigen::Vector3d(1.0, 2.0, 3.0), same.linear_velocity);
  EXPECT_FALSE(same.covariance);
}

TEST(LeverArm, takes_off_what_the_rotation_adds_and_its_uncertainty) {
  LeverArm arm(0.1, 0.01);
  const Eigen::Matrix3d gyro_covariance = Eigen::Vector3d(1e-4, 4e-4, 9e-4).asDiagonal();
  arm.note({fromSeconds(1.0), kRate, gyro_covariance});
  const Eigen::Vector3d of_imu(2.0, 0.1, 0.0);
  const VelocitySample at_point{fromSeconds(1.1), of_imu + kRate.cross(kArm), Eigen::Matrix3d::Identity(),
                                kArm};
  const VelocitySample carried = arm.atImu(at_point);
  EXPECT_LT((carried.linear_velocity - of_imu).norm(), 1e-12);
  EXPECT_TRUE(carried.lever_arm.isZero(0.0));
  const Eigen::Matrix3d J = so3::hat(kArm);
  const Eigen::Matrix3d expected = Eigen::Matrix3d::Identity() + J * gyro_covariance * J.transpose();
  EXPECT_LT((*carried.covariance - expected).norm(), 1e-12);
}

TEST(LeverArm, knows_no_rate_that_was_not_measured_just_now) {
  LeverArm arm(0.1, 0.01);
  const VelocitySample sample{fromSeconds(9.0), {2.0, 0.0, 0.0}, {}, kArm};
  const VelocitySample before = arm.atImu(sample);
  arm.note({fromSeconds(8.0), kRate, {}});
  const VelocitySample stale = arm.atImu(sample);
  arm.note({fromSeconds(8.9), kRate, {}});
  const VelocitySample fresh = arm.atImu(sample);
  EXPECT_EQ(before.linear_velocity, stale.linear_velocity);
  EXPECT_GT(stale.covariance->trace(), 1.0);
  EXPECT_NEAR(fresh.covariance->trace(), 3.0 * 0.01 + 2.0 * 1e-4 * kArm.squaredNorm(), 1e-12);
}

} // namespace
} // namespace vi_ekf_slam

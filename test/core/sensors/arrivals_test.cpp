#include "vi_ekf_slam/core/sensors/arrivals.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "../system_drive.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(Arrivals, CountWhatIsNoMeasurementByStreamAndReason) {
  Arrivals arrivals({});
  EXPECT_TRUE(arrivals.isValid(gyro(1.0)));
  ImuSample imu = gyro(1.0);
  imu.angular_velocity.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(arrivals.isValid(imu));
  imu.angular_velocity.x() = 2.0 * kMaxAngularSpeed;
  EXPECT_FALSE(arrivals.isValid(imu));
  VelocitySample sample = velocity(1.0);
  sample.covariance = -Eigen::Matrix3d::Identity();
  EXPECT_FALSE(arrivals.isValid(sample));
  EXPECT_EQ(arrivals.counts().invalid[kGyro], 2U);
  EXPECT_EQ(arrivals.counts().too_fast[kGyro], 1U);
  EXPECT_EQ(arrivals.counts().invalid[kVelocity], 1U);
  EXPECT_EQ(arrivals.counts().bad_covariance[kVelocity], 1U);
}

TEST(Arrivals, HandOutEveryMeasurementInTheOrderOfStamps) {
  Arrivals arrivals({});
  EXPECT_FALSE(arrivals.duration());
  arrivals.add(velocity(10.02));
  arrivals.add(gyro(10.01));
  arrivals.add(gyro(10.03));
  EXPECT_NEAR(*arrivals.duration(), 0.01, 1e-9);
  std::vector<Stamp> stamps;
  while (const auto next = arrivals.popRegardless()) stamps.push_back(stampOf(*next));
  EXPECT_EQ(stamps, (std::vector<Stamp>{fromSeconds(10.01), fromSeconds(10.02), fromSeconds(10.03)}));
  EXPECT_TRUE(arrivals.empty());
}

TEST(Arrivals, HoldAJumpUntilItIsTakenInEvenWhereAllElseIsForgotten) {
  MeasurementBuffer::Options options;
  options.jump_confirmations = 3;
  Arrivals arrivals(options);
  arrivals.add(gyro(10.0));
  EXPECT_EQ(arrivals.add(gyro(5.0)), Arrivals::Verdict::kHeld);
  EXPECT_EQ(arrivals.add(gyro(5.01)), Arrivals::Verdict::kHeld);
  EXPECT_EQ(arrivals.add(gyro(5.02)), Arrivals::Verdict::kJump);
  EXPECT_NEAR(arrivals.jump(), -5.0, 1e-9);
  arrivals.close();
  arrivals.clear();
  EXPECT_FALSE(arrivals.newest());
  arrivals.goOn();
  EXPECT_EQ(*arrivals.newest(), fromSeconds(5.02));
  EXPECT_NEAR(*arrivals.duration(), 0.02, 1e-9);
  EXPECT_EQ(total(arrivals.counts().behind), 0U);
}

TEST(Arrivals, CountAsStrayWhatNothingConfirmedAtTheEnd) {
  Arrivals arrivals({});
  arrivals.add(gyro(10.0));
  arrivals.add(gyro(9e4));
  EXPECT_EQ(total(arrivals.counts().ahead), 0U);
  arrivals.close();
  EXPECT_EQ(arrivals.counts().ahead[kGyro], 1U);
}

} // namespace
} // namespace vi_ekf_slam

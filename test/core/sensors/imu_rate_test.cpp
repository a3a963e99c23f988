#include "vi_ekf_slam/core/sensors/imu_rate.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {
namespace {

/// What is said after the last of samples at these times, s.
std::optional<bool> after(const std::vector<double>& times) {
  ImuRate rate;
  std::optional<bool> said;
  for (const double t : times) said = rate.suffices(fromSeconds(t));
  return said;
}

TEST(ImuRate, IsKnownFromASecondSampleOrFromFiveThatAreFarApart) {
  EXPECT_EQ(after({1.0}), std::nullopt);
  EXPECT_EQ(after({1.0, 1.0025}), true);
  EXPECT_EQ(after({1.0, 1.02}), true); // 50 Hz
  EXPECT_EQ(after({1.0, 1.1, 1.2, 1.3}), std::nullopt);
  EXPECT_EQ(after({1.0, 1.1, 1.2, 1.3, 1.4}), false);
}

TEST(ImuRate, IsNotThatOfALostSampleOrOfARepeatedOne) {
  EXPECT_EQ(after({1.0, 1.3, 1.305}), true);
  EXPECT_EQ(after({1.0, 1.0, 1.0, 1.0, 1.0, 1.0}), std::nullopt);
}

std::string motionOf(double imu_hz, int samples) {
  SlamSystem system(Config{});
  for (int i = 0; i < samples; ++i)
    system.add(ImuSample{
        fromSeconds(1.0 + i / imu_hz), Eigen::Vector3d::Zero(), {}, Eigen::Vector3d(0.0, 0.0, 9.81), {}});
  return system.motionText();
}

TEST(ImuRate, ChoosesTheMotion) {
  EXPECT_EQ(motionOf(100.0, 1), "");
  EXPECT_EQ(motionOf(100.0, 2), "inertial, the IMU's messages carry accelerations");
  EXPECT_EQ(motionOf(10.0, 4), "");
  EXPECT_EQ(
      motionOf(10.0, 5),
      "constant twist, the IMU's messages come at less than 50 Hz, too seldom for their accelerations to "
      "be integrated (motion: inertial does it none the less)");
}

} // namespace
} // namespace vi_ekf_slam

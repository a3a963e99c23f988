#include "vi_ekf_slam/ros/intake.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace vi_ekf_slam {
namespace {

/// What the intake says of 20 frames of 40 features with this disparity and this difference of rows, px.
std::vector<std::string> saidOf(double disparity, double rows) {
  SlamSystem system{Config()};
  Intake intake(system, {}, {});
  std::vector<std::string> said;
  intake.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (unsigned k = 0; k < 20; ++k) {
    StereoFeatureArray message;
    message.header.frame_id = "left_camera_optical";
    message.header.stamp = ros::Time(100, 50000000U * k % 1000000000U);
    for (unsigned i = 0; i < 40; ++i) {
      StereoFeature feature;
      feature.id = i;
      feature.u_left = static_cast<float>(100.0 + 10.0 * i);
      feature.v_left = 200.0F;
      feature.u_right = static_cast<float>(feature.u_left - disparity);
      feature.v_right = static_cast<float>(feature.v_left - rows);
      message.features.push_back(feature);
    }
    intake.add(message);
  }
  EXPECT_EQ(said.empty(), intake.stereoCheck().problem().empty());
  return said;
}

TEST(Intake, SaysOnceWhatFeaturesAreNotThoseOfARectifiedPair) {
  EXPECT_TRUE(saidOf(20.0, 0.0).empty());
  const auto rows = saidOf(20.0, 5.0);
  ASSERT_EQ(1U, rows.size());
  EXPECT_EQ(0U, rows[0].find(
                    "matched points lie in different rows: 5 px (median of 400 points), allowed: 2.29 px"));
  const auto sides = saidOf(-20.0, 0.0);
  ASSERT_EQ(1U, sides.size()) << "features that are dropped for it are looked at before";
  EXPECT_EQ(0U, sides[0].find("disparity has the wrong sign: 100 % of the points are behind the cameras"));
}

/// What is missing of a gyro and a camera without calibration.
std::string missingWith(const std::string& velocity, const std::string& wheel_odometry) {
  Config config;
  config.invariant.choice = MotionChoice::kConstantTwist;
  SlamSystem system{config};
  InputTopics topics;
  topics.velocity = velocity;
  topics.wheel_odometry = wheel_odometry;
  Intake intake(system, {}, topics);
  sensor_msgs::Imu imu;
  imu.header.frame_id = "imu_link";
  StereoFeatureArray features;
  features.header.frame_id = "left_camera_optical";
  imu.header.stamp = features.header.stamp = ros::Time(100, 0);
  intake.add(imu);
  intake.add(features);
  return intake.missingInputs();
}

TEST(Intake, MissesAVelocityUnlessToldThatThereIsNone) {
  EXPECT_EQ(missingWith("/velocity", "/wheels"), "/velocity or /wheels");
  EXPECT_EQ(missingWith("/velocity", ""), "/velocity");
  EXPECT_EQ(missingWith("", "/wheels"), "/wheels");
  EXPECT_EQ(missingWith("", ""), "");
}

} // namespace
} // namespace vi_ekf_slam

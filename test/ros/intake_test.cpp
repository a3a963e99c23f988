#include "vi_ekf_slam/ros/intake.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace vi_ekf_slam {
namespace {

ros::Time secondsOn(double t) { return ros::Time(100.0 + t); }

/// 40 features that stay where they are, with this disparity and this difference of rows, px.
StereoFeatureArray featuresAt(double t, double disparity, double rows = 0.0) {
  StereoFeatureArray message;
  message.header.frame_id = "left_camera_optical";
  message.header.stamp = secondsOn(t);
  for (unsigned i = 0; i < 40; ++i) {
    StereoFeature feature;
    feature.id = i;
    feature.u_left = static_cast<float>(100.0 + 10.0 * i);
    feature.v_left = static_cast<float>(150.0 + 40.0 * (i % 4));
    feature.u_right = static_cast<float>(feature.u_left - disparity);
    feature.v_right = static_cast<float>(feature.v_left - rows);
    message.features.push_back(feature);
  }
  return message;
}

/// What the intake says of 20 frames of 40 features with this disparity and this difference of rows, px.
std::vector<std::string> saidOf(double disparity, double rows) {
  SlamSystem system{Config()};
  Intake intake(system, {}, {});
  std::vector<std::string> said;
  intake.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (int k = 0; k < 20; ++k) intake.add(featuresAt(0.05 * k, disparity, rows));
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

/// A gyro's sample of 1 rad/s at most, with these variances, (rad/s)^2.
sensor_msgs::Imu gyroAt(double t, double x, double y, double z) {
  sensor_msgs::Imu message;
  message.header.frame_id = "imu_link";
  message.header.stamp = secondsOn(t);
  message.angular_velocity.z = 1.0;
  message.angular_velocity_covariance = {x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z};
  return message;
}

TEST(Intake, NeedsNoVarianceOfEachAxisOfAnImu) {
  SlamSystem system{Config()};
  Intake intake(system, {}, {});
  intake.add(gyroAt(0.0, 0.0, 0.0, 1e-6));
  auto accelerates = gyroAt(0.1, 0.0, 0.0, 0.0);
  accelerates.linear_acceleration.z = 9.81;
  accelerates.linear_acceleration_covariance[8] = 1e-4;
  intake.add(accelerates);
  intake.flush();
  system.flush();
  EXPECT_EQ(2U, system.counts().processed[static_cast<std::size_t>(Stream::kImu)]);
  EXPECT_TRUE(intake.turnedAway().empty());
}

TEST(Intake, CountsWhatHasNoPlausibleValues) {
  SlamSystem system{Config()};
  Intake intake(system, {}, {});
  for (const double t : {0.0, 0.1}) intake.add(gyroAt(t, 1e-6, 1e-6, -1e-6));
  auto fast = gyroAt(0.2, 1e-6, 1e-6, 1e-6);
  fast.angular_velocity.x = 1e6;
  intake.add(fast);
  const std::map<std::string, std::uint64_t> expected = {{"imu: covariance not positive definite", 2},
                                                         {"imu: too fast", 1}};
  EXPECT_EQ(expected, intake.turnedAway());
  EXPECT_EQ("imu", intake.unusedInputs());
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

/// A camera at rest, of 10 Hz and without an IMU up to now.
class CameraAlone : public testing::Test {
 protected:
  CameraAlone() {
    system_.onReset([this](const std::string& reason, const PathEstimate&) { resets_.push_back(reason); });
    intake_.onProblem([this](const std::string& text) { said_.push_back(text); });
    sensor_msgs::CameraInfo info;
    info.header.frame_id = "left_camera_optical";
    info.P = {500.0, 0.0, 300.0, 0.0, 0.0, 500.0, 200.0, 0.0, 0.0, 0.0, 1.0, 0.0};
    intake_.addLeftInfo(info);
    info.P[3] = -250.0;
    intake_.addRightInfo(info);
  }

  void addFrames(double begin, double end) {
    for (double t = begin; t < end; t += 0.1) intake_.add(featuresAt(t, 20.0));
  }
  /// An IMU at rest with the axes of the camera's mounting: z up.
  void addImu(double begin, double end, bool accelerates) {
    sensor_msgs::Imu imu;
    imu.header.frame_id = "imu_link";
    imu.linear_acceleration.z = accelerates ? 9.81 : 0.0;
    for (double t = begin; t < end; t += 0.005) {
      imu.header.stamp = secondsOn(t);
      intake_.add(imu);
    }
  }
  void connect() {
    geometry_msgs::TransformStamped t;
    t.header.frame_id = "imu_link";
    t.child_frame_id = "left_camera_optical";
    t.transform.rotation.x = t.transform.rotation.z = -0.5;
    t.transform.rotation.y = t.transform.rotation.w = 0.5;
    tf2_msgs::TFMessage message;
    message.transforms.push_back(t);
    intake_.addTransforms(message, true);
  }

  SlamSystem system_{Config()};
  Intake intake_{system_, {}, {}};
  std::vector<std::string> resets_, said_;
};

TEST_F(CameraAlone, IsNamedWhereFeaturesAreOfAnotherFrame) {
  for (const char* frame : {"left_camera", "left_camera", ""}) {
    auto features = featuresAt(0.0, 20.0);
    features.header.frame_id = frame;
    intake_.add(features);
  }
  const std::vector<std::string> expected = {
      "features in 'left_camera' are not used: left/camera_info is of 'left_camera_optical'",
      "features in '' are not used: left/camera_info is of 'left_camera_optical'"};
  EXPECT_EQ(expected, said_);
  EXPECT_EQ("features", intake_.unusedInputs());
  addFrames(0.1, 4.0);
  intake_.flush();
  system_.flush();
  EXPECT_EQ("", intake_.unusedInputs());
}

TEST_F(CameraAlone, IsTheBodyByItself) {
  addFrames(0.0, 4.0);
  EXPECT_EQ("left_camera_optical", intake_.imuFrame());
  EXPECT_EQ("", intake_.missingInputs());
  ASSERT_EQ(1U, said_.size());
  EXPECT_EQ(
      "no message on imu: what moves is the left camera, 'left_camera_optical'; ros/imu_frame may name "
      "another "
      "frame",
      said_[0]);
  intake_.flush();
  system_.flush();
  EXPECT_EQ(0U, system_.counts().frames_without_rig) << "the first frames wait for it";
  EXPECT_GT(system_.counts().features_used, 1000U);
}

TEST_F(CameraAlone, IsTheBodyOfARecordingThatEndsWhileItWaits) {
  addFrames(0.0, 1.0);
  EXPECT_EQ("", intake_.imuFrame());
  intake_.flush();
  system_.flush();
  EXPECT_EQ("left_camera_optical", intake_.imuFrame());
  EXPECT_EQ(0U, system_.counts().frames_without_rig);
  EXPECT_GT(system_.counts().features_used, 200U);
}

TEST_F(CameraAlone, MakesWayForAnImuThatComesLate) {
  addFrames(0.0, 3.0);
  addImu(3.0, 3.1, true);
  EXPECT_EQ("left_camera_optical", intake_.imuFrame()) << "nothing says where the camera is on the IMU";
  EXPECT_TRUE(resets_.empty());
  ASSERT_EQ(2U, said_.size());
  EXPECT_NE(std::string::npos, said_[1].find("no transform from 'imu_link' to 'left_camera_optical'"))
      << said_[1];
  connect();
  for (double t = 3.1; t < 6.0; t += 0.1) {
    addImu(t, t + 0.1, true);
    addFrames(t + 0.1, t + 0.15);
  }
  EXPECT_EQ("imu_link", intake_.imuFrame());
  EXPECT_EQ(MotionChoice::kInertial, system_.motion());
  ASSERT_FALSE(resets_.empty());
  EXPECT_EQ("an IMU has come, and takes the left camera's place as what moves", resets_[0]);
  EXPECT_TRUE(system_.estimator().hasStarted()) << system_.estimator().startProblem();
}

TEST_F(CameraAlone, MakesWayForAGyroThatComesLate) {
  addFrames(0.0, 3.0);
  connect();
  addImu(3.0, 3.1, false);
  EXPECT_EQ("imu_link", intake_.imuFrame());
  EXPECT_EQ(1U, resets_.size());
  EXPECT_TRUE(system_.estimator().state().world_T_imu.rotation().isIdentity(1e-3)) << "not that of a camera";
}

TEST_F(CameraAlone, IsNoneWithAVelocity) {
  geometry_msgs::TwistWithCovarianceStamped velocity;
  velocity.header.frame_id = "base_link";
  velocity.header.stamp = secondsOn(0.0);
  intake_.add(velocity);
  addFrames(0.0, 4.0);
  EXPECT_EQ("", intake_.imuFrame());
  EXPECT_EQ("imu", intake_.missingInputs());
}

TEST(Intake, MissesAVelocityUnlessToldThatThereIsNone) {
  EXPECT_EQ(missingWith("/velocity", "/wheels"), "/velocity or /wheels");
  EXPECT_EQ(missingWith("/velocity", ""), "/velocity");
  EXPECT_EQ(missingWith("", "/wheels"), "/wheels");
  EXPECT_EQ(missingWith("", ""), "");
}

} // namespace
} // namespace vi_ekf_slam

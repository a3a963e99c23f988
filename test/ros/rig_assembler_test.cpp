#include "vi_ekf_slam/ros/input/rig_assembler.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>

namespace vi_ekf_slam {
namespace {

sensor_msgs::CameraInfo info(bool right) {
  sensor_msgs::CameraInfo m;
  m.header.frame_id = right ? "right_optical" : "left_optical";
  m.P = {500.0, 0.0, 320.0, right ? -250.0 : 0.0, 0.0, 510.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return m;
}

/// imu -> left optical: x right, y down, z forward, 0.4 m ahead of the IMU.
tf2_msgs::TFMessage extrinsic() {
  geometry_msgs::TransformStamped t;
  t.header.frame_id = "imu_link";
  t.child_frame_id = "left_optical";
  t.transform.translation.x = 0.4;
  t.transform.rotation.x = t.transform.rotation.z = -0.5;
  t.transform.rotation.y = t.transform.rotation.w = 0.5;
  tf2_msgs::TFMessage m;
  m.transforms.push_back(t);
  return m;
}

class Rig : public testing::Test {
 protected:
  void addAll(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right) {
    rig_.setImuFrame("imu_link");
    addTransforms(extrinsic(), true);
    rig_.addLeft(left);
    rig_.addRight(right);
  }
  bool complainsOf(const std::string& text) const {
    return !rig_.rig() && rig_.problem().find(text) != std::string::npos;
  }
  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static) {
    frames_.add(message, is_static);
    rig_.noteTransforms();
  }
  FrameTree frames_;
  RigAssembler rig_{frames_, "/left", "/right"};
};

TEST_F(Rig, knows_no_borders_where_a_camera_shows_more_than_the_rectified_picture) {
  auto left = info(false), right = info(true);
  left.width = right.width = 640;
  left.height = right.height = 480;
  left.D = right.D = std::vector<double>(5, 0.0);
  left.K = right.K = {500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0};
  addAll(left, right);
  ASSERT_TRUE(rig_.imageSize());
  EXPECT_EQ(640.0, rig_.imageSize()->width);
  const auto knowsBorders = [&](const sensor_msgs::CameraInfo& other) {
    RigAssembler raw{frames_, "/left", "/right"};
    raw.setImuFrame("imu_link");
    raw.addLeft(left);
    raw.addRight(other);
    EXPECT_TRUE(raw.rig());
    return raw.imageSize().has_value();
  };
  EXPECT_TRUE(knowsBorders(right));
  auto bent = right, turned = right, wider = right, unknown = right;
  bent.D[0] = -0.2;
  turned.R = {0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  wider.K[0] = wider.K[4] = 300.0;
  unknown.K.fill(0.0);
  EXPECT_FALSE(knowsBorders(bent));
  EXPECT_FALSE(knowsBorders(turned));
  EXPECT_FALSE(knowsBorders(wider));
  EXPECT_TRUE(knowsBorders(unknown));
}

TEST_F(Rig, names_numbers_that_no_rig_has) {
  for (const double focal_length : {5e-324, 1e-3, 1e308}) {
    auto left = info(false), right = info(true);
    left.P[0] = left.P[5] = right.P[0] = right.P[5] = focal_length;
    addAll(left, right);
    EXPECT_TRUE(complainsOf("from 1 to 1e6 px")) << rig_.problem();
  }
  for (const double shift : {-5e-324, -1e308}) {
    auto right = info(true);
    right.P[3] = shift;
    addAll(info(false), right);
    EXPECT_TRUE(complainsOf("1e-6 to 1e3 m")) << rig_.problem();
  }
}

TEST_F(Rig, names_a_lever_arm_that_no_rig_has) {
  auto far = extrinsic();
  far.transforms[0].transform.translation.y = 1e308;
  rig_.setImuFrame("imu_link");
  addTransforms(far, true);
  rig_.addLeft(info(false));
  rig_.addRight(info(true));
  EXPECT_TRUE(complainsOf("at most 10 km")) << rig_.problem();
}

TEST_F(Rig, is_complete_with_two_infos_and_the_transform_whatever_the_order) {
  rig_.addRight(info(true));
  addTransforms(extrinsic(), true);
  rig_.addLeft(info(false));
  EXPECT_FALSE(rig_.rig());
  rig_.setImuFrame("imu_link");
  ASSERT_TRUE(rig_.rig());
  EXPECT_EQ("", rig_.problem());
  const StereoCamera& c = rig_.rig()->camera;
  EXPECT_EQ(500.0, c.fu);
  EXPECT_EQ(510.0, c.fv);
  EXPECT_EQ(320.0, c.cu);
  EXPECT_EQ(240.0, c.cv);
  EXPECT_EQ(0.5, c.baseline);
}

TEST_F(Rig, takes_imu_points_to_the_left_optical_frame) {
  addAll(info(false), info(true));
  ASSERT_TRUE(rig_.rig());
  // 10 m ahead, 2 m to the left, 1 m up in the IMU frame: x right, y down, z forward in the camera.
  const Eigen::Vector3d p = rig_.rig()->cam_T_imu * Eigen::Vector3d(10.4, 2.0, 1.0);
  EXPECT_LT((p - Eigen::Vector3d(-2.0, -1.0, 10.0)).norm(), 1e-12);
}

TEST_F(Rig, carries_the_transform_to_the_rectified_camera_by_R) {
  auto left = info(false);
  const double c = std::cos(0.1), s = std::sin(0.1);
  left.R = {c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c}; // 0.1 rad about y
  addAll(left, info(true));
  ASSERT_TRUE(rig_.rig());
  // (-2, -1, 10) in the camera as it is mounted.
  const Eigen::Vector3d p = rig_.rig()->cam_T_imu * Eigen::Vector3d(10.4, 2.0, 1.0);
  EXPECT_LT((p - Eigen::Vector3d(-2.0 * c - 10.0 * s, -1.0, -2.0 * s + 10.0 * c)).norm(), 1e-12);
  EXPECT_EQ("", rig_.changedLater());
  left.R[1] = 1e-3;
  rig_.addLeft(left);
  EXPECT_EQ("camera_info", rig_.changedLater());
}

TEST_F(Rig, refuses_an_R_that_is_no_rotation) {
  auto right = info(true);
  right.R[0] = 1.0;
  addAll(info(false), right);
  EXPECT_TRUE(complainsOf("R of /right must be a rotation"));
}

TEST_F(Rig, names_every_missing_piece) {
  EXPECT_TRUE(complainsOf("/left"));
  EXPECT_TRUE(complainsOf("/right"));
  rig_.addLeft(info(false));
  EXPECT_FALSE(complainsOf("on /left"));
  rig_.addRight(info(true));
  EXPECT_TRUE(complainsOf("IMU's frame"));
  rig_.setImuFrame("imu_link");
  EXPECT_TRUE(complainsOf("no transform from 'imu_link' to 'left_optical'"));
}

TEST_F(Rig, a_transform_on_tf_serves_as_well) {
  rig_.setImuFrame("imu_link");
  rig_.addLeft(info(false));
  rig_.addRight(info(true));
  auto moving = extrinsic();
  moving.transforms[0].header.stamp = ros::Time(12.0);
  addTransforms(moving, false);
  EXPECT_TRUE(rig_.rig());
}

TEST_F(Rig, refuses_a_pair_that_is_not_rectified) {
  auto right = info(true);
  right.P[2] += 5.0;
  addAll(info(false), right);
  EXPECT_TRUE(complainsOf("cx is 320 px on the left and 325 px"));
}

TEST_F(Rig, refuses_exchanged_cameras) {
  addAll(info(true), info(false));
  EXPECT_TRUE(complainsOf("P[3] of the left camera must be 0"));
}

TEST_F(Rig, refuses_a_positive_right_offset) {
  auto right = info(true);
  right.P[3] = 250.0;
  addAll(info(false), right);
  EXPECT_TRUE(complainsOf("must be negative, it is 250"));
}

TEST_F(Rig, refuses_cameras_that_are_not_side_by_side) {
  auto right = info(true);
  right.P[7] = -5.0;
  addAll(info(false), right);
  EXPECT_TRUE(complainsOf("the baseline has a vertical part")) << rig_.problem();
  auto below = info(true);
  below.P[7] = std::exchange(below.P[3], 0.0);
  rig_.addRight(below);
  EXPECT_TRUE(complainsOf("the cameras are one above the other")) << rig_.problem();
  right.P[7] = -0.5; // as some rectifications leave it
  rig_.addRight(right);
  EXPECT_TRUE(rig_.rig()) << rig_.problem();
}

TEST_F(Rig, refuses_an_uncalibrated_camera_and_nan) {
  addAll(sensor_msgs::CameraInfo(), info(true));
  EXPECT_TRUE(complainsOf("not calibrated"));
  auto left = info(false);
  left.P[6] = std::numeric_limits<double>::quiet_NaN();
  rig_.addLeft(left);
  EXPECT_TRUE(complainsOf("not finite"));
  rig_.addLeft(info(false)); // a good one that comes later mends it
  EXPECT_TRUE(rig_.rig());
}

TEST_F(Rig, keeps_the_first_calibration_and_notes_a_change) {
  addAll(info(false), info(true));
  rig_.addLeft(info(false));
  EXPECT_EQ("", rig_.changedLater());
  auto left = info(false);
  left.P[0] = 600.0;
  rig_.addLeft(left);
  EXPECT_EQ("camera_info", rig_.changedLater());
  EXPECT_EQ(500.0, rig_.rig()->camera.fu);
}

TEST_F(Rig, keeps_the_first_transform_and_notes_another_one) {
  addAll(info(false), info(true));
  auto other = extrinsic();
  other.transforms[0].transform.translation.x += 1e-4; // written with fewer digits
  addTransforms(other, true);
  EXPECT_EQ("", rig_.changedLater());
  other.transforms[0].transform.translation.x += 0.01;
  addTransforms(other, true);
  EXPECT_EQ("the transform from 'imu_link' to 'left_optical'", rig_.changedLater());
  EXPECT_LT((rig_.rig()->cam_T_imu * Eigen::Vector3d(0.4, 0.0, 0.0)).norm(), 1e-12);
}

} // namespace
} // namespace vi_ekf_slam

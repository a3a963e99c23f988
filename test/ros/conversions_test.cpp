#include "vi_ekf_slam/ros/conversions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace vi_ekf_slam {
namespace {

using namespace conversions;

sensor_msgs::Imu imu() {
  sensor_msgs::Imu m;
  m.header.stamp = ros::Time(5, 123456789);
  m.header.frame_id = "imu_link";
  m.angular_velocity.x = 0.1;
  m.angular_velocity.y = 0.2;
  m.angular_velocity.z = 0.3;
  return m;
}

geometry_msgs::TwistWithCovarianceStamped velocity() {
  geometry_msgs::TwistWithCovarianceStamped m;
  m.header = imu().header;
  m.twist.twist.linear.x = 1.0;
  m.twist.twist.linear.z = -2.0;
  return m;
}

StereoFeatureArray features() {
  StereoFeatureArray m;
  m.header.stamp = ros::Time(5, 0);
  m.header.frame_id = "left";
  m.features.resize(3);
  for (std::size_t i = 0; i < 3; ++i) m.features[i].id = i + 7;
  m.features[1].u_left = 10.0;
  m.features[1].v_left = 20.0;
  m.features[1].u_right = 5.0;
  m.features[1].v_right = 21.0;
  return m;
}

TEST(ToGyro, keeps_stamp_and_value_exactly) {
  const auto c = toImu(imu(), "imu_link");
  ASSERT_TRUE(c.sample);
  EXPECT_EQ(5123456789, c.sample->stamp);
  EXPECT_EQ(Eigen::Vector3d(0.1, 0.2, 0.3), c.sample->angular_velocity);
}

TEST(ToGyro, zero_covariance_is_unknown_and_any_other_is_taken) {
  auto m = imu();
  EXPECT_FALSE(toImu(m, "imu_link").sample->covariance);
  for (std::size_t i = 0; i < 9; ++i) m.angular_velocity_covariance[i] = static_cast<double>(i + 1);
  const auto c = toImu(m, "imu_link");
  ASSERT_TRUE(c.sample && c.sample->covariance);
  EXPECT_EQ(2.0, (*c.sample->covariance)(0, 1)); // row-major
  EXPECT_EQ(7.0, (*c.sample->covariance)(2, 0));
}

TEST(ToGyro, says_why_it_turns_a_message_away) {
  auto m = imu();
  m.header.stamp = ros::Time();
  EXPECT_EQ(Rejection::kZeroStamp, toImu(m, "imu_link").rejection);
  EXPECT_EQ(Rejection::kWrongFrame, toImu(imu(), "other").rejection);
  m = imu();
  m.header.frame_id = "";
  EXPECT_EQ(Rejection::kWrongFrame, toImu(m, "").rejection);
  m = imu();
  m.angular_velocity_covariance[0] = -1.0;
  EXPECT_EQ(Rejection::kNoData, toImu(m, "imu_link").rejection);
  m = imu();
  m.angular_velocity.y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Rejection::kNotFinite, toImu(m, "imu_link").rejection);
  m = imu();
  m.angular_velocity_covariance[4] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(Rejection::kNotFinite, toImu(m, "imu_link").rejection);
}

TEST(ToGyro, takes_an_acceleration_unless_it_is_said_not_to_be_one_or_is_zero) {
  auto m = imu();
  m.linear_acceleration.x = m.linear_acceleration.y = m.linear_acceleration.z = 0.0;
  EXPECT_FALSE(toImu(m, "imu_link").sample->acceleration);
  m.linear_acceleration.z = 9.8;
  ASSERT_TRUE(toImu(m, "imu_link").sample->acceleration);
  EXPECT_EQ(Eigen::Vector3d(0.0, 0.0, 9.8), *toImu(m, "imu_link").sample->acceleration);
  EXPECT_FALSE(toImu(m, "imu_link").sample->acceleration_covariance);
  m.linear_acceleration_covariance[0] = m.linear_acceleration_covariance[4] = 0.25;
  m.linear_acceleration_covariance[8] = 0.5;
  EXPECT_EQ(0.5, (*toImu(m, "imu_link").sample->acceleration_covariance)(2, 2));
  m.linear_acceleration_covariance[0] = -1.0;
  EXPECT_FALSE(toImu(m, "imu_link").sample->acceleration);
  m.linear_acceleration_covariance[0] = 0.25;
  m.linear_acceleration.y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Rejection::kNotFinite, toImu(m, "imu_link").rejection);
}

TEST(ToGyro, a_leading_slash_of_tf1_is_the_same_frame) {
  auto m = imu();
  m.header.frame_id = "/imu_link";
  EXPECT_TRUE(toImu(m, "imu_link").sample);
}

TEST(ToVelocity, takes_the_linear_block_only) {
  auto m = velocity();
  m.twist.covariance[35] = 4.0; // angular: does not count
  EXPECT_FALSE(toVelocity(m).sample->covariance);
  m.twist.covariance[0] = m.twist.covariance[7] = m.twist.covariance[14] = 0.5;
  m.twist.covariance[6] = m.twist.covariance[1] = 0.1;
  const auto c = toVelocity(m);
  ASSERT_TRUE(c.sample && c.sample->covariance);
  EXPECT_EQ(Eigen::Vector3d(1.0, 0.0, -2.0), c.sample->linear_velocity);
  EXPECT_EQ(Eigen::Vector3d::Constant(0.5), c.sample->covariance->diagonal());
  EXPECT_EQ(0.1, (*c.sample->covariance)(1, 0));
}

TEST(ToVelocity, says_why_it_turns_a_message_away) {
  auto m = velocity();
  m.header.frame_id = "";
  EXPECT_EQ(Rejection::kWrongFrame, toVelocity(m).rejection);
  m = velocity();
  m.twist.twist.linear.x = -std::numeric_limits<double>::infinity();
  EXPECT_EQ(Rejection::kNotFinite, toVelocity(m).rejection);
}

TEST(ToTwistBias, takes_mean_and_diagonal) {
  auto m = velocity();
  m.twist.twist.angular.z = 0.25;
  for (std::size_t i = 0; i < 6; ++i) m.twist.covariance[7 * i] = 0.25;
  m.twist.covariance[1] = m.twist.covariance[6] = 0.1; // does not count
  const auto c = toTwistBias(m, "imu_link");
  ASSERT_TRUE(c.sample);
  EXPECT_EQ((Vector6d() << 1.0, 0.0, -2.0, 0.0, 0.0, 0.25).finished(), c.sample->mean);
  EXPECT_EQ(Vector6d::Constant(0.5), c.sample->sigma);
}

TEST(ToTwistBias, says_why_it_turns_a_message_away) {
  auto m = velocity();
  EXPECT_EQ(Rejection::kNoData,
            toTwistBias(m, "imu_link").rejection); // nothing is known with a variance of 0
  for (std::size_t i = 0; i < 6; ++i) m.twist.covariance[7 * i] = 1.0;
  EXPECT_EQ(Rejection::kWrongFrame, toTwistBias(m, "base_link").rejection);
  m.twist.covariance[35] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(Rejection::kNotFinite, toTwistBias(m, "imu_link").rejection);
}

TEST(ToFrame, keeps_pixels_in_the_order_left_right) {
  const auto c = toFrame(features(), "left");
  ASSERT_TRUE(c.sample);
  ASSERT_EQ(3U, c.sample->features.size());
  EXPECT_EQ(8U, c.sample->features[1].id);
  EXPECT_EQ(StereoPixels(10.0, 20.0, 5.0, 21.0), c.sample->features[1].pixels);
}

TEST(ToFrame, keeps_what_a_message_made_of_a_frame_holds) {
  StereoFrame frame;
  frame.stamp = 5000000000;
  Descriptor descriptor;
  descriptor.fill(7);
  frame.features.push_back({7, StereoPixels(10.5, 20.0, 5.0, 21.0), 0.5, 0.25, descriptor});
  frame.features.push_back({8, StereoPixels(11.5, 21.0, 6.0, 22.0)});
  const auto again = toFrame(toMessage(frame, "left"), "left");
  ASSERT_TRUE(again.sample);
  EXPECT_EQ(again.sample->stamp, frame.stamp);
  ASSERT_EQ(again.sample->features.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    const StereoFeatureObservation &expected = frame.features[i], &feature = again.sample->features[i];
    EXPECT_EQ(feature.id, expected.id);
    EXPECT_EQ(feature.pixels, expected.pixels);
    EXPECT_EQ(feature.sigma, expected.sigma);
    EXPECT_EQ(feature.walk, expected.walk);
    EXPECT_EQ(feature.descriptor, expected.descriptor);
  }
}

TEST(ToFrame, keeps_the_first_of_repeated_ids_and_counts_the_rest) {
  auto m = features();
  m.features[2].id = m.features[1].id;
  m.features[2].u_left = 99.0;
  const auto c = toFrame(m, "left");
  ASSERT_TRUE(c.sample);
  EXPECT_EQ(1U, c.repeated_ids);
  ASSERT_EQ(2U, c.sample->features.size());
  EXPECT_EQ(10.0, c.sample->features[1].pixels[0]);
}

TEST(ToFrame, checks_the_frame_once_it_is_known) {
  EXPECT_TRUE(toFrame(features(), "").sample);
  EXPECT_EQ(Rejection::kWrongFrame, toFrame(features(), "right").rejection);
  auto m = features();
  m.header.stamp = ros::Time();
  EXPECT_EQ(Rejection::kZeroStamp, toFrame(m, "left").rejection);
}

TEST(Stamps, survive_the_round_trip_to_the_nanosecond) {
  const ros::Time time(1317386425, 562502384);
  EXPECT_EQ(1317386425562502384, toStamp(time));
  EXPECT_EQ(time, toTime(toStamp(time)));
}

StateEstimate state() {
  StateEstimate s;
  s.stamp = 5000000001;
  Vector6d xi;
  xi << 1.0, 2.0, 3.0, 0.1, -0.2, 2.5;
  s.world_T_imu = SE3::Exp(xi);
  for (Eigen::Index i = 0; i < 6; ++i) {
    s.twist[i] = static_cast<double>(i) + 1.0;
    for (Eigen::Index j = 0; j < 6; ++j) s.pose_covariance(i, j) = static_cast<double>(10 * i + j);
  }
  s.twist_covariance = 2.0 * s.pose_covariance;
  return s;
}

TEST(ToOdometry, has_the_pose_in_map_and_the_twist_in_the_child_frame) {
  const auto m = toOdometry(state(), "map", "imu_link");
  EXPECT_EQ("map", m.header.frame_id);
  EXPECT_EQ("imu_link", m.child_frame_id);
  EXPECT_EQ(ros::Time(5, 1), m.header.stamp);
  EXPECT_EQ(3.0, m.twist.twist.linear.z);
  EXPECT_EQ(4.0, m.twist.twist.angular.x);
  EXPECT_EQ(13.0, m.pose.covariance[1 * 6 + 3]); // row-major
  EXPECT_EQ(2.0 * 52.0, m.twist.covariance[5 * 6 + 2]);
}

TEST(ToTransform, is_the_pose_of_the_child_in_the_parent) {
  const auto m = toTransform(state().world_T_imu, 7, "map", "imu_link");
  EXPECT_EQ("map", m.header.frame_id);
  EXPECT_EQ("imu_link", m.child_frame_id);
  EXPECT_LT((toSE3(m.transform).matrix() - state().world_T_imu.matrix()).cwiseAbs().maxCoeff(), 1e-14);
  const auto pose = toPose(state().world_T_imu);
  EXPECT_EQ(pose.position.x, m.transform.translation.x);
  EXPECT_EQ(pose.orientation.w, m.transform.rotation.w);
}

} // namespace
} // namespace vi_ekf_slam

// Which frame a number is of: the base beside the IMU, velocities of other frames, odometry of others.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <functional>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"
#include "vi_ekf_slam/ros/input/velocity_frames.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/node/told.hpp"
#include "vi_ekf_slam/ros/output/base_frame.hpp"
#include "vi_ekf_slam/ros/output/smooth_odometry.hpp"
#include "vi_ekf_slam/ros/output/transform_publisher.hpp"

namespace vi_ekf_slam {
namespace {

SE3 pose(double x, double y, double z, double roll, double pitch, double yaw) {
  return SE3(
      (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()))
          .toRotationMatrix(),
      {x, y, z});
}

const SE3 kBaseTImu = pose(0.3, -0.2, 0.9, 0.4, -0.3, 1.2);
const SE3 kWorldTImu = pose(10.0, -4.0, 2.0, 0.1, 0.5, -2.0);

tf2_msgs::TFMessage transform(const SE3& parent_T_child, const std::string& parent, const std::string& child,
                              Stamp stamp) {
  tf2_msgs::TFMessage message;
  message.transforms.push_back(conversions::toTransform(parent_T_child, stamp, parent, child));
  return message;
}

Matrix6d anyCovariance() {
  Matrix6d A;
  for (Eigen::Index i = 0; i < 36; ++i) A(i) = std::sin(1.0 + 3.7 * static_cast<double>(i));
  return A * A.transpose() + Matrix6d::Identity();
}

void expectNear(const SE3& a, const SE3& b, double tolerance) {
  EXPECT_LT((a.matrix() - b.matrix()).cwiseAbs().maxCoeff(), tolerance);
}

class Base : public testing::Test {
 protected:
  Base() {
    config_.base_frame = "base_link";
    frames_.add(transform(kBaseTImu, "base_link", "imu_link", 1), true);
  }
  /// J of the base's pose error by the IMU's, both (dp, dtheta) along fixed axes, by differences.
  Matrix6d numericJacobian(const std::function<SE3(const SE3&)>& change, const SE3& at) {
    Matrix6d J;
    const double h = 1e-6;
    for (Eigen::Index i = 0; i < 6; ++i) {
      const Vector6d e = h * Vector6d::Unit(i);
      const SE3 moved(so3::Exp(e.tail<3>()) * at.rotation(), at.translation() + e.head<3>());
      const SE3 from = change(at), to = change(moved);
      J.col(i) << to.translation() - from.translation(),
          so3::Log(to.rotation() * from.rotation().transpose());
      J.col(i) /= h;
    }
    return J;
  }

  FrameTree frames_;
  RosConfig config_;
};

TEST_F(Base, is_the_imu_where_nothing_else_is_asked_for) {
  BaseFrame base(frames_, {});
  EXPECT_FALSE(base.update("", SE3()));
  ASSERT_TRUE(base.update("imu_link", SE3()));
  EXPECT_EQ("imu_link", base.name());
  EXPECT_EQ(kWorldTImu.matrix(), base.pose(kWorldTImu).matrix());
  base.lookForParent(fromSeconds(100.0));
  EXPECT_FALSE(base.mayGetParent());
  EXPECT_NE(std::string::npos, base.problem().find("base_frame")) << base.problem();
}

TEST_F(Base, has_no_parent_any_more_that_nobody_publishes) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", SE3()));
  frames_.add(transform(pose(1, 0, 0, 0, 0, 0), "odom", "base_link", fromSeconds(20.0)), false);
  base.lookForParent(fromSeconds(20.5));
  EXPECT_FALSE(base.mayGetParent());
  EXPECT_NE(std::string::npos, base.problem().find("'odom' -> 'base_link'")) << base.problem();
  base.lookForParent(fromSeconds(26.0));
  EXPECT_TRUE(base.mayGetParent());
  EXPECT_EQ("", base.problem());
}

TEST_F(Base, has_no_parent_where_the_imu_says_that_it_is_the_odometry) {
  BaseFrame base(frames_, {});
  ASSERT_TRUE(base.update("odom", SE3()));
  EXPECT_FALSE(base.mayGetParent());
  EXPECT_NE(std::string::npos, base.problem().find("header.frame_id of imu, is 'odom', allowed: another"))
      << base.problem();
}

TEST_F(Base, keeps_the_first_transform_and_says_that_it_has_changed) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", SE3()));
  const SE3 before = base.pose(kWorldTImu);
  base.noteTransforms();
  EXPECT_EQ("", base.change());
  frames_.add(transform(kBaseTImu * pose(0, 0, 0, 0, 0.01, 0), "base_link", "imu_link", 1), true);
  base.noteTransforms();
  EXPECT_NE(std::string::npos, base.change().find("'base_link' to the IMU's frame 'imu_link' has changed"))
      << base.change();
  expectNear(before, base.pose(kWorldTImu), 1e-12);
}

/// Pose of the IMU, and a landmark seen from the base, are those of the world.
void expectTheSameFrom(const BaseFrame& base) {
  expectNear(kWorldTImu, base.imuPose(base.pose(kWorldTImu)), 1e-12);
  LandmarkEstimate landmark;
  landmark.position = {5.0, 6.0, 7.0};
  const Eigen::Vector3d from_base = kBaseTImu * (kWorldTImu.inverse() * landmark.position);
  const auto moved = base.landmarks({landmark});
  EXPECT_LT((base.pose(kWorldTImu).inverse() * moved[0].position - from_base).norm(), 1e-12);
}

TEST_F(Base, begins_the_map_where_it_began) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", SE3()));
  EXPECT_EQ("", base.problem());
  expectNear(SE3(), base.pose(SE3()), 1e-12);
  expectNear(kBaseTImu * kWorldTImu * kBaseTImu.inverse(), base.pose(kWorldTImu), 1e-12);
  expectTheSameFrom(base);
}

TEST_F(Base, begins_the_map_where_it_began_in_a_world_that_begins_elsewhere) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", kWorldTImu));
  expectNear(SE3(), base.pose(kWorldTImu), 1e-12);
  const SE3 moved = SE3::Exp((Vector6d() << 1.0, 2.0, 3.0, 0.1, 0.2, 0.3).finished());
  expectNear(kBaseTImu * moved * kBaseTImu.inverse(), base.pose(kWorldTImu * moved), 1e-12);
}

TEST_F(Base, keeps_the_z_axis_of_a_world_that_has_it_up) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", std::nullopt));
  EXPECT_LT((base.mapFromWorld().rotation().col(2) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  // The IMU begins at the world's origin without a heading, as a level base has it.
  Eigen::Matrix3d world_R_imu = kBaseTImu.rotation();
  world_R_imu = so3::Exp(Eigen::Vector3d(0.0, 0.0, -so3::heading(world_R_imu))) * world_R_imu;
  expectNear(SE3(), base.pose(SE3(world_R_imu, Eigen::Vector3d::Zero())), 1e-12);
  expectTheSameFrom(base);
}

TEST_F(Base, takes_a_told_state_of_the_map_into_the_world) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", std::nullopt));
  const SE3 map_T_imu = base.mapFromWorld() * kWorldTImu;
  const Eigen::Matrix3d& R = base.mapFromWorld().rotation();
  SetState::Request request;
  request.header.frame_id = "map";
  request.header.stamp = ros::Time(12.5);
  request.pose = conversions::toPose(map_T_imu);
  request.velocity.x = 3.0;
  request.gyro_bias.y = 0.01;
  request.accelerometer_bias.z = 0.1;
  Eigen::Matrix<double, 15, 15, Eigen::RowMajor> P = decltype(P)::Identity();
  P.topLeftCorner<6, 6>() = anyCovariance();
  P(6, 6) = 9.0;
  P(0, 6) = P(6, 0) = 0.5;
  Eigen::Map<decltype(P)>(request.covariance.data()) = P;
  InitialState state;
  ASSERT_EQ("", readToldState(request, "map", base, state));
  EXPECT_EQ(fromSeconds(12.5), state.stamp);
  expectNear(kWorldTImu, state.world_T_imu, 1e-9);
  EXPECT_LT((R * state.velocity - Eigen::Vector3d(3.0, 0.0, 0.0)).norm(), 1e-12);
  EXPECT_EQ(0.01, state.gyro_bias.y());
  EXPECT_EQ(0.1, state.accelerometer_bias.z());
  // Errors along the map's axes are those along the world's, turned.
  const auto block = [](const auto& m, Eigen::Index row, Eigen::Index col) {
    return Eigen::Matrix3d(m.template block<3, 3>(row, col));
  };
  for (const Eigen::Index row : {0, 3, 6}) {
    for (const Eigen::Index col : {0, 3, 6})
      EXPECT_LT((R * block(state.covariance, row, col) * R.transpose() - block(P, row, col)).norm(), 1e-9);
  }
  EXPECT_LT((block(state.covariance, 9, 9) - Eigen::Matrix3d::Identity()).norm(), 1e-12);
}

class BaseOfWorld : public Base, public testing::WithParamInterface<std::optional<SE3>> {};
INSTANTIATE_TEST_SUITE_P(Worlds, BaseOfWorld, testing::Values(std::nullopt, SE3(), kWorldTImu));

TEST_P(BaseOfWorld, has_the_covariance_of_its_own_pose) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", GetParam()));
  StateEstimate state;
  state.world_T_imu = kWorldTImu;
  state.pose_covariance = anyCovariance();
  const auto there = [&](const SE3& p) { return base.pose(p); };
  const Matrix6d J = numericJacobian(there, kWorldTImu);
  const Matrix6d expected = J * state.pose_covariance * J.transpose();
  const StateEstimate of_base = base.state(state);
  EXPECT_LT((expected - of_base.pose_covariance).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_LT((base.imuCovariance(of_base.world_T_imu, of_base.pose_covariance) - state.pose_covariance)
                .cwiseAbs()
                .maxCoeff(),
            1e-9);
}

TEST_P(BaseOfWorld, has_the_twist_of_its_own_origin) {
  BaseFrame base(frames_, config_);
  ASSERT_TRUE(base.update("imu_link", GetParam()));
  StateEstimate state;
  state.world_T_imu = kWorldTImu;
  state.twist << 2.0, 0.1, -0.2, 0.3, -0.4, 0.5;
  state.twist_covariance = anyCovariance();
  const double h = 1e-6;
  const SE3 step = base.pose(kWorldTImu).inverse() * base.pose(kWorldTImu * SE3::Exp(h * state.twist));
  const StateEstimate of_base = base.state(state);
  EXPECT_LT((step.Log() / h - of_base.twist).norm(), 1e-6);
  Matrix6d J;
  for (Eigen::Index i = 0; i < 6; ++i) {
    StateEstimate other = state;
    other.twist += Vector6d::Unit(i);
    J.col(i) = base.state(other).twist - of_base.twist;
  }
  const Matrix6d expected = J * state.twist_covariance * J.transpose();
  EXPECT_LT((expected - of_base.twist_covariance).cwiseAbs().maxCoeff(), 1e-9);
}

TEST_F(Base, says_what_is_missing) {
  config_.base_frame = "chassis";
  BaseFrame base(frames_, config_);
  EXPECT_FALSE(base.update("imu_link", SE3()));
  EXPECT_NE(std::string::npos, base.problem().find("'chassis'")) << base.problem();
  frames_.add(transform(pose(1e6, 0, 0, 0, 0, 0), "chassis", "base_link", 1), true);
  EXPECT_FALSE(base.update("imu_link", SE3())) << "a vehicle is not that large";
}

TEST_F(Base, is_told_where_it_is) {
  BaseFrame base(frames_, config_);
  geometry_msgs::PoseWithCovarianceStamped message;
  message.header.frame_id = "/map";
  message.pose.pose = conversions::toPose(base.pose(kWorldTImu));
  ToldPose told;
  EXPECT_NE("", readToldPose(message, "map", base, SE3(), told)) << "the base is not known";
  ASSERT_TRUE(base.update("imu_link", SE3()));
  message.pose.pose = conversions::toPose(base.pose(kWorldTImu));
  ASSERT_EQ("", readToldPose(message, "map", base, SE3(), told));
  expectNear(kWorldTImu, told.world_T_imu, 1e-9);
  const Matrix6d covariance = anyCovariance();
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(message.pose.covariance.data()) = covariance;
  ASSERT_EQ("", readToldPose(message, "map", base, SE3(), told));
  StateEstimate state;
  state.world_T_imu = told.world_T_imu;
  state.pose_covariance = told.covariance;
  EXPECT_LT((base.state(state).pose_covariance - covariance).cwiseAbs().maxCoeff(), 1e-9);
  message.pose.covariance[1] += 1.0; // no longer symmetric
  EXPECT_NE("", readToldPose(message, "map", base, SE3(), told));
}

TEST(SmoothOdometryTest, goes_on_over_a_new_start) {
  SmoothOdometry odometry;
  StateEstimate state;
  state.twist_covariance.diagonal() << 0.01, 0.01, 0.01, 1e-4, 1e-4, 1e-4;
  for (int i = 0; i <= 100; ++i) {
    state.stamp = fromSeconds(0.1 * i);
    odometry.update(SE3::Exp(0.1 * i * Vector6d::Unit(0)), state);
  }
  const StateEstimate before = odometry.update(SE3::Exp(10.0 * Vector6d::Unit(0)), state);
  EXPECT_NEAR(10.0, before.world_T_imu.translation().x(), 1e-9);
  // 0.1 m/s that is another one after each second, for 10 s; the heading's error aside from what it does.
  EXPECT_NEAR(0.1, before.pose_covariance(0, 0), 1e-6);
  EXPECT_GT(before.pose_covariance(1, 1), 0.1 + 0.01);
  EXPECT_NEAR(3.0, odometry.motionSince(fromSeconds(7.0)).translation().x(), 1e-9);
  EXPECT_NEAR(0.0, odometry.motionSince(fromSeconds(70.0)).translation().x(), 1e-9);
  EXPECT_NEAR(0.0, odometry.motionSince(0 - 1).translation().x(), 1e-9);
  odometry.restart();
  EXPECT_EQ(SE3().matrix(), odometry.motionSince(fromSeconds(7.0)).matrix());
  state.stamp = fromSeconds(3.0);                                 // time may go back
  const StateEstimate after = odometry.update(kWorldTImu, state); // a start may be anywhere
  expectNear(before.world_T_imu, after.world_T_imu, 1e-12);
  EXPECT_EQ(before.pose_covariance, after.pose_covariance);
  state.stamp = fromSeconds(3.5);
  const SE3 motion = SE3::Exp(0.5 * Vector6d::Unit(1));
  expectNear(before.world_T_imu * motion, odometry.update(kWorldTImu * motion, state).world_T_imu, 1e-12);
}

TEST(ForeignOdometryTest, waits_for_the_transform_of_the_same_stamp) {
  FrameTree frames;
  ForeignOdometry foreign(frames, "odom");
  const SE3 map_T_odom = pose(3.0, 1.0, 0.0, 0.0, 0.0, 0.7);
  const auto odom_T_base = [](double t) { return pose(t, 0.0, 0.0, 0.0, 0.0, 0.0); };
  for (const double t : {1.0, 1.1, 1.2, 1.3}) foreign.add(fromSeconds(t), map_T_odom * odom_T_base(t));
  EXPECT_FALSE(foreign.take("base_link"));
  for (const double t : {0.95, 1.15}) // of a clock of its own; in between it is interpolated
    frames.add(transform(odom_T_base(t), "odom", "base_link", fromSeconds(t)), false);
  const auto correction = foreign.take("base_link");
  ASSERT_TRUE(correction);
  EXPECT_EQ(fromSeconds(1.1), correction->stamp);
  expectNear(map_T_odom, correction->map_T_odom, 1e-9);
  EXPECT_FALSE(foreign.take("base_link")) << "the rest is later than what is known";
  EXPECT_EQ(2U, foreign.waiting());
}

class Velocities : public testing::Test {
 protected:
  static geometry_msgs::TwistWithCovarianceStamped velocity(const std::string& frame, double t) {
    geometry_msgs::TwistWithCovarianceStamped m;
    m.header.frame_id = frame;
    m.header.stamp = conversions::toTime(fromSeconds(t));
    m.twist.twist.linear.x = 1.0;
    return m;
  }
  static sensor_msgs::Imu imu(const std::string& frame, double t) {
    sensor_msgs::Imu m;
    m.header.frame_id = frame;
    m.header.stamp = conversions::toTime(fromSeconds(t));
    return m;
  }
  std::uint64_t processed(Stream stream) {
    intake_.flush();
    system_.flush();
    return system_.counts().processed[static_cast<std::size_t>(stream)];
  }
  SlamSystem system_{Config()};
  Intake intake_{system_, {}, {}};
  std::vector<std::string> problems_;
};

TEST_F(Velocities, are_turned_to_the_axes_of_the_imu_with_their_lever_arm) {
  FrameTree frames;
  frames.add(transform(kBaseTImu, "base_link", "imu_link", 1), true);
  VelocityFrames velocities(frames, {});
  VelocitySample sample{1, {1.0, 2.0, 3.0}, Eigen::Vector3d(1.0, 4.0, 9.0).asDiagonal(), {}};
  EXPECT_FALSE(velocities.carry(sample, "base_link")) << "the IMU's frame is not known";
  velocities.setImuFrame("imu_link");
  ASSERT_TRUE(velocities.carry(sample, "base_link"));
  const Eigen::Matrix3d R = kBaseTImu.rotation().transpose();
  EXPECT_LT((sample.linear_velocity - R * Eigen::Vector3d(1.0, 2.0, 3.0)).norm(), 1e-12);
  EXPECT_LT((sample.lever_arm - kBaseTImu.inverse().translation()).norm(), 1e-12);
  EXPECT_LT(
      (R.transpose() * *sample.covariance * R - Eigen::Matrix3d(Eigen::Vector3d(1.0, 4.0, 9.0).asDiagonal()))
          .norm(),
      1e-9);
}

TEST_F(Velocities, do_not_say_what_the_frame_of_the_imu_is) {
  intake_.add(velocity("base_link", 1.0));
  intake_.add(imu("imu_link", 1.0));
  EXPECT_EQ("imu_link", intake_.imuFrame());
  intake_.addTransforms(transform(kBaseTImu, "base_link", "imu_link", 1), true);
  EXPECT_EQ(1U, processed(Stream::kImu));
  EXPECT_EQ(1U, processed(Stream::kVelocity));
}

TEST_F(Velocities, need_no_variance_of_each_axis) {
  intake_.add(imu("imu_link", 1.0));
  auto ahead_alone = velocity("imu_link", 1.0);
  ahead_alone.twist.covariance[0] = 0.01;
  intake_.add(ahead_alone);
  EXPECT_EQ(1U, processed(Stream::kVelocity));
  EXPECT_EQ(0U, system_.counts().bad_covariance[static_cast<std::size_t>(Stream::kVelocity)]);
}

TEST_F(Velocities, hold_up_nothing_once_one_was_used) {
  intake_.onProblem([this](const std::string& problem) { problems_.push_back(problem); });
  intake_.add(imu("imu_link", 1.0));
  intake_.add(velocity("imu_link", 1.0));
  for (const double t : {1.1, 1.2}) intake_.add(velocity("wheel", t));
  EXPECT_EQ(2U, intake_.turnedAway().at("velocity: no transform from its frame to the IMU's"));
  ASSERT_EQ(1U, problems_.size());
  EXPECT_NE(std::string::npos, problems_[0].find("'wheel'"));
  EXPECT_EQ(1U, processed(Stream::kVelocity));
}

TEST_F(Velocities, wait_for_their_transform_no_longer_than_for_the_calibration) {
  intake_.add(imu("imu_link", 1.0));
  intake_.add(velocity("wheel", 1.0));
  intake_.add(imu("imu_link", 2.9));
  EXPECT_EQ(0U, intake_.turnedAway().size());
  intake_.add(imu("imu_link", 3.0));
  EXPECT_EQ(1U, intake_.turnedAway().size());
}

} // namespace
} // namespace vi_ekf_slam

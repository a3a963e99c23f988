/// Messages of any content through Intake into SlamSystem, and what comes out back into messages.
#include <ros/serialization.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "fuzz_bytes.hpp"
#include "system_checks.hpp"
#include "vi_ekf_slam/ros/intake.hpp"

namespace vi_ekf_slam::fuzz {
namespace {

constexpr std::size_t kMostMessages = 120;

std::string chooseFrameName(FuzzBytes& bytes, const char* usual) {
  const std::uint8_t choice = bytes.byte();
  if (choice < 230) return usual;
  if (choice < 240) return std::string("/") + usual;
  if (choice < 245) return "imu";
  return choice < 250 ? "" : bytes.text(20);
}

std_msgs::Header chooseHeader(FuzzBytes& bytes, const char* frame, ros::Time& now) {
  const std::uint8_t choice = bytes.byte();
  const ros::Duration step(choice < 128 ? 0.01 : 0.1);
  if (choice < 245) {
    now = now + step;
  } else if (choice < 250) {
    now = ros::Time(bytes.word(), bytes.word() % 1000000000U);
  } // else the same stamp again
  std_msgs::Header header;
  header.stamp = choice == 255 ? ros::Time() : now;
  header.frame_id = chooseFrameName(bytes, frame);
  return header;
}

template <typename Array>
void fillCovariance(FuzzBytes& bytes, std::size_t stride, Array& covariance) {
  const std::size_t kind = bytes.below(8);
  if (kind < 4) return;
  for (std::size_t i = 0; i < 3; ++i) covariance[i * (stride + 1)] = bytes.number(0.01);
  if (kind == 7) covariance[1 + bytes.below(covariance.size() - 1)] = bytes.number(0.001);
}

sensor_msgs::Imu chooseImu(FuzzBytes& bytes, ros::Time& now) {
  sensor_msgs::Imu m;
  m.header = chooseHeader(bytes, "imu", now);
  m.angular_velocity.x = bytes.number(bytes.small(0.2));
  m.angular_velocity.y = bytes.number(0.0);
  m.angular_velocity.z = bytes.number(bytes.small(0.5));
  fillCovariance(bytes, 3, m.angular_velocity_covariance);
  return m;
}

geometry_msgs::TwistWithCovarianceStamped chooseVelocity(FuzzBytes& bytes, ros::Time& now) {
  geometry_msgs::TwistWithCovarianceStamped m;
  m.header = chooseHeader(bytes, "imu", now);
  m.twist.twist.linear.x = bytes.number(bytes.small(20.0));
  m.twist.twist.linear.y = bytes.number(bytes.small(1.0));
  m.twist.twist.linear.z = bytes.number(0.0);
  fillCovariance(bytes, 6, m.twist.covariance);
  return m;
}

/// Wheel odometry: a velocity of its child frame.
nav_msgs::Odometry chooseOdometry(FuzzBytes& bytes, ros::Time& now) {
  nav_msgs::Odometry m;
  m.header = chooseHeader(bytes, "odom", now);
  m.child_frame_id = chooseFrameName(bytes, "imu");
  m.twist.twist.linear.x = bytes.number(bytes.small(20.0));
  m.twist.twist.angular.z = bytes.number(0.0);
  fillCovariance(bytes, 6, m.twist.covariance);
  return m;
}

StereoFeatureArray chooseFeatures(FuzzBytes& bytes, ros::Time& now) {
  StereoFeatureArray m;
  m.header = chooseHeader(bytes, "left", now);
  m.features.resize(bytes.below(20));
  std::uint64_t id = bytes.byte();
  for (StereoFeature& f : m.features) {
    f.id = id;
    f.u_left = bytes.number(100.0 + 50.0 * static_cast<double>(id % 17));
    f.v_left = bytes.number(100.0);
    f.u_right = f.u_left - bytes.number(5.0 + bytes.small(4.0));
    f.v_right = f.v_left + bytes.small(1.0);
    if (bytes.below(4) == 3) {
      f.sigma = static_cast<float>(bytes.number(1.0));
      f.walk = static_cast<float>(bytes.number(0.3));
    }
    if (bytes.below(16) != 0) ++id;
  }
  return m;
}

sensor_msgs::CameraInfo chooseInfo(FuzzBytes& bytes, double shift, ros::Time& now) {
  sensor_msgs::CameraInfo m;
  m.header = chooseHeader(bytes, "left", now);
  m.P = {700.0, 0.0, 600.0, shift, 0.0, 700.0, 180.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  if (bytes.below(4) == 3) m.P[bytes.below(m.P.size())] = bytes.number(bytes.small(1000.0));
  if (bytes.below(16) == 15) m.P[0] = m.P[5] = bytes.number(700.0);
  if (bytes.below(16) == 15) m.binning_x = bytes.byte();
  return m;
}

tf2_msgs::TFMessage chooseTransforms(FuzzBytes& bytes, ros::Time& now) {
  tf2_msgs::TFMessage m;
  m.transforms.resize(1 + bytes.below(3));
  for (geometry_msgs::TransformStamped& t : m.transforms) {
    t.header = chooseHeader(bytes, "imu", now);
    t.child_frame_id = chooseFrameName(bytes, "left");
    t.transform.translation.x = bytes.number(0.1);
    t.transform.translation.z = bytes.number(bytes.small(2.0));
    t.transform.rotation.w = bytes.number(0.5);
    t.transform.rotation.x = bytes.number(-0.5);
    t.transform.rotation.y = 0.5;
    t.transform.rotation.z = -0.5;
  }
  return m;
}

/// The estimate as messages: all numbers finite, the quaternion a unit one, and legible from the wire.
void checkMessages(const Output& output) {
  checkOutput(output);
  const nav_msgs::Odometry odometry = conversions::toOdometry(output.state, "map", "imu");
  const auto& q = odometry.pose.pose.orientation;
  require(std::abs(std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z) - 1.0) < 1e-6,
          "a quaternion is a unit one");
  const auto finite = [](double x) { return std::isfinite(x); };
  require(std::all_of(odometry.pose.covariance.begin(), odometry.pose.covariance.end(), finite) &&
              std::all_of(odometry.twist.covariance.begin(), odometry.twist.covariance.end(), finite),
          "covariances in messages are finite");
  require(conversions::toStamp(odometry.header.stamp) == output.state.stamp, "stamps are kept");
}

void run(FuzzBytes bytes) {
  SlamSystem system({});
  system.onFrame(checkMessages);
  system.onImu(checkMessages);
  Intake intake(system, {}, {});
  ros::Time now(1000000000);
  for (std::size_t i = 0; i < kMostMessages && !bytes.empty(); ++i) {
    const std::size_t kind = bytes.below(32);
    if (kind < 10) {
      intake.add(chooseImu(bytes, now));
    } else if (kind < 17) {
      intake.add(chooseVelocity(bytes, now));
    } else if (kind == 17) {
      intake.add(chooseOdometry(bytes, now));
    } else if (kind < 27) {
      intake.add(chooseFeatures(bytes, now));
    } else if (kind == 27) {
      intake.addLeftInfo(chooseInfo(bytes, 0.0, now));
    } else if (kind == 28) {
      intake.addRightInfo(chooseInfo(bytes, -350.0, now));
    } else {
      intake.addTransforms(chooseTransforms(bytes, now), kind != 29);
    }
    require(system.hasRig() || !intake.rigAssembler().problem().empty(),
            "a missing calibration is explained");
  }
  system.flush();
  checkLandmarks(system.estimator(), kMostMessages * 20);
}

} // namespace
} // namespace vi_ekf_slam::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  vi_ekf_slam::fuzz::run({data, size});
  return 0;
}

// Sensors that do not move the body as the pictures do are named, and no others.

#include <algorithm>
#include <cmath>

#include "../road.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam::test {
namespace {

struct Fault {
  double gyro = 1.0; ///< times what it measures
  Eigen::Matrix3d velocity = Eigen::Matrix3d::Identity();
  StereoRig rig = exampleRig();
};

Vector6d twistOf(double speed, double yaw_rate) {
  return (Vector6d() << speed, 0.0, 0.0, 0.0, 0.0, yaw_rate).finished();
}

/// All that is said in `seconds` of a drive with that twist.
std::string saidOf(const Fault& fault, const Vector6d& twist, double seconds = 20.0, double frames = 10.0,
                   int samples = 1) {
  Road road(3, 40, {0.1, 0.01, 0.5});
  road.setRates(frames, samples);
  road.setTwist(twist);
  MotionCheck check{InvariantConfig()};
  check.setRig(fault.rig);
  std::string said;
  for (int k = 0; k < static_cast<int>(seconds * frames); ++k) {
    for (int i = 0; i < samples; ++i) {
      if (i > 0) road.move();
      ImuSample gyro = road.gyro();
      gyro.angular_velocity *= fault.gyro;
      VelocitySample velocity = road.velocity();
      velocity.linear_velocity = (fault.velocity * velocity.linear_velocity).eval();
      check.note(gyro);
      check.note(velocity);
    }
    said += check.note(road.frame());
    road.move();
  }
  return said;
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }
const std::string kTurn = "the gyro does not turn as the pictures do",
                  kWay = "the velocity does not move as the pictures do";

const Vector6d kBend = twistOf(8.0, 0.3);

TEST(MotionCheck, SaysNothingOfASoundRig) {
  EXPECT_EQ(saidOf({}, kBend), "");
  EXPECT_EQ(saidOf({}, kBend, 10.0, 30.0, 4), "");
  EXPECT_EQ(saidOf({}, twistOf(8.0, 0.0)), "") << "straight ahead";
  EXPECT_EQ(saidOf({}, twistOf(0.0, 0.0)), "") << "at rest";
  EXPECT_EQ(saidOf({}, twistOf(0.0, 0.4)), "") << "on the spot";
}

TEST(MotionCheck, TakesAnOrdinaryErrorForNone) {
  Fault off;
  off.gyro = 1.1;
  off.velocity = 0.9 * so3::Exp({0.0, 0.1, 0.1});
  off.rig.cam_T_imu = SE3(so3::Exp({0.05, 0.05, 0.05}), Eigen::Vector3d(0.1, 0.1, 0.1)) * off.rig.cam_T_imu;
  EXPECT_EQ(saidOf(off, kBend), "");
}

TEST(MotionCheck, NamesATransformThatIsInverted) {
  Fault fault;
  fault.rig.cam_T_imu = fault.rig.cam_T_imu.inverse();
  const std::string said = saidOf(fault, kBend);
  EXPECT_TRUE(has(said, kTurn) && has(said, kWay)) << said;
  EXPECT_TRUE(has(said, "is that not inverted?")) << said;
}

TEST(MotionCheck, NamesTheGyro) {
  Fault fault;
  fault.gyro = -1.0;
  std::string said = saidOf(fault, kBend);
  EXPECT_TRUE(has(said, kTurn) && has(said, "are the gyro's axes those of the transform")) << said;
  EXPECT_FALSE(has(said, kWay)) << said;
  fault.gyro = 57.3;
  said = saidOf(fault, kBend);
  EXPECT_TRUE(has(said, kTurn) && has(said, "is the gyro in deg/s?")) << said;
}

TEST(MotionCheck, NamesASensorThatIsStuck) {
  Fault fault;
  fault.gyro = 0.0;
  std::string said = saidOf(fault, kBend);
  EXPECT_TRUE(has(said, kTurn) && has(said, "is it connected? all its samples are the same")) << said;
  EXPECT_FALSE(has(said, kWay)) << said;
  fault = {};
  fault.velocity.setZero();
  said = saidOf(fault, kBend);
  EXPECT_TRUE(has(said, kWay) && has(said, "is its sensor connected?")) << said;
  EXPECT_FALSE(has(said, kTurn)) << said;
  EXPECT_EQ(saidOf(fault, twistOf(0.0, 0.4)), "") << "on the spot";
}

TEST(MotionCheck, NamesTheVelocityOrTheBaseline) {
  Fault fault;
  for (const double scale : {3.6, 0.4}) {
    fault.velocity = scale * Eigen::Matrix3d::Identity();
    const std::string said = saidOf(fault, kBend);
    EXPECT_TRUE(has(said, kWay) && has(said, "is the velocity in m/s")) << said;
    EXPECT_FALSE(has(said, kTurn)) << said;
  }
  for (const double yaw : {3.14, 1.57}) {
    fault.velocity = so3::Exp({0.0, 0.0, yaw});
    const std::string said = saidOf(fault, kBend);
    EXPECT_TRUE(has(said, kWay) && has(said, "is the velocity backwards")) << said;
  }
  fault = {};
  fault.rig.camera.baseline *= 2.0;
  EXPECT_TRUE(has(saidOf(fault, kBend), kWay));
}

// One that has an accelerometer may have a larger bias.
TEST(MotionCheck, AllowsForTheBiasOfAnInertialUnit) {
  for (const bool is_inertial : {false, true}) {
    Road road(5, 40, {0.1, 0.01, 0.5});
    road.setTwist(twistOf(8.0, 0.2));
    road.setGyroBias({0.0, 0.15, 0.0});
    MotionCheck check{InvariantConfig()};
    check.setRig(exampleRig());
    for (int k = 0; k < 200; ++k) {
      ImuSample gyro = road.gyro();
      if (is_inertial) gyro.acceleration = Eigen::Vector3d(0.0, 0.0, 9.81);
      check.note(gyro);
      check.note(road.frame());
      road.move();
    }
    EXPECT_EQ(has(check.problem(), kTurn), !is_inertial) << check.problem();
  }
}

// A bias is common to all windows; where the body turns one way alone, a wrong sign looks like one.
TEST(MotionCheck, TellsTheSignOfAnInertialUnitFromItsBias) {
  for (const bool turns_both_ways : {true, false}) {
    Road road(6, 40, {0.1, 0.01, 0.5});
    MotionCheck check{InvariantConfig()};
    check.setRig(exampleRig());
    for (int k = 0; k < 300; ++k) {
      road.setTwist(twistOf(8.0, turns_both_ways && k / 40 % 2 == 1 ? -0.2 : 0.2));
      ImuSample gyro = road.gyro();
      gyro.angular_velocity *= -1.0;
      gyro.acceleration = Eigen::Vector3d(0.0, 0.0, 9.81);
      check.note(gyro);
      check.note(road.frame());
      road.move();
    }
    EXPECT_EQ(has(check.problem(), kTurn), turns_both_ways) << check.problem();
  }
}

/// What is said of a hand that turns a rig to and fro, where `offset` (s) is to be added to the pictures'
/// stamps.
std::string saidOfClocks(double offset, const InvariantConfig& config = {}) {
  constexpr double kFrames = 10.0;
  constexpr int kSamples = 20;
  Road road(7, 40, {0.0, 0.003, 0.5});
  road.setRates(kFrames, kSamples);
  road.setGyroBias({0.02, -0.05, 0.03});
  std::vector<Measurement> all;
  for (int k = 0; k < 40 * static_cast<int>(kFrames) * kSamples; ++k) {
    const double t = k / (kFrames * kSamples);
    road.setTwist(
        (Vector6d() << 0.8, 0.0, 0.0, 0.0, 0.3 * std::sin(2.1 * t), 0.5 * std::sin(1.5 * t)).finished());
    ImuSample gyro = road.gyro();
    gyro.acceleration = Eigen::Vector3d(0.0, 0.0, 9.81);
    gyro.covariance = 9e-6 * Eigen::Matrix3d::Identity();
    all.emplace_back(gyro);
    if (k % kSamples == 0) {
      StereoFrame frame = road.frame();
      frame.stamp -= fromSeconds(offset);
      all.emplace_back(frame);
    }
    road.move();
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& a, const auto& b) { return stampOf(a) < stampOf(b); });
  MotionCheck check(config);
  check.setRig(exampleRig());
  std::string said;
  for (const Measurement& m : all) {
    if (const auto* frame = std::get_if<StereoFrame>(&m))
      said += check.note(*frame);
    else
      check.note(std::get<ImuSample>(m));
  }
  return said;
}

TEST(MotionCheck, NamesTheClockOfThePictures) {
  EXPECT_EQ(saidOfClocks(0.0), "");
  EXPECT_EQ(saidOfClocks(0.005), "");
  for (const double offset : {-0.03, 0.03}) {
    const std::string said = saidOfClocks(offset);
    ASSERT_TRUE(has(said, ") off the gyro's clock, allowed: 0.01")) << said;
    const std::string key = "set calibration/time_offset: ";
    ASSERT_TRUE(has(said, key)) << said;
    // It is said once it is five standard deviations; here within three, and half the time between samples.
    EXPECT_NEAR(std::stod(said.substr(said.find(key) + key.size())), offset, 0.02) << said;
  }
  InvariantConfig estimates;
  estimates.rig.time_offset_sigma = 0.01;
  EXPECT_EQ(saidOfClocks(0.03, estimates), "");
}

TEST(MotionCheck, IsPartOfTheSystemAndSaysItOnce) {
  Config config;
  SlamSystem system(config);
  std::vector<std::string> said;
  system.onProblem([&said](const std::string& text) { said.push_back(text); });
  system.setRig(exampleRig());
  Road road(4, 40, {0.1, 0.01, 0.5});
  road.setTwist(kBend);
  for (int k = 0; k < 200; ++k) {
    VelocitySample velocity = road.velocity();
    velocity.linear_velocity *= -1.0;
    system.add(road.gyro());
    system.add(velocity);
    system.add(road.frame());
    road.move();
  }
  system.flush();
  ASSERT_EQ(said.size(), 1U);
  EXPECT_TRUE(has(said.front(), kWay)) << said.front();
  EXPECT_EQ(system.checks().motion.problem(), said.front());
}

} // namespace
} // namespace vi_ekf_slam::test

#include "vi_ekf_slam/core/slam/motion_selection.hpp"

#include <gtest/gtest.h>

#include "../system_drive.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

ImuSample accelerated(double t) {
  ImuSample sample = gyro(t);
  sample.acceleration = Eigen::Vector3d(0.0, 0.0, 9.81);
  return sample;
}

TEST(MotionSelection, IsInertialForAnImuWithAccelerationsThatIsFastEnough) {
  MotionSelection selection{Config()};
  EXPECT_TRUE(selection.isOpen());
  EXPECT_EQ(selection.text(), "");
  for (int i = 0; i < 10 && selection.isOpen(); ++i) selection.note(accelerated(0.01 * i));
  EXPECT_TRUE(selection.isInertial());
  EXPECT_EQ(selection.text(), "inertial, the IMU's messages carry accelerations");
}

TEST(MotionSelection, IsAConstantTwistForASlowImuOneWithoutAccelerationsAndNone) {
  MotionSelection slow{Config()}, gyro_alone{Config()}, none{Config()};
  for (int i = 0; i < 1000 && slow.isOpen(); ++i) slow.note(accelerated(0.1 * i));
  for (int i = 0; i < 3; ++i) gyro_alone.note(gyro(0.1 * i));
  none.close();
  EXPECT_EQ(slow.choice(), MotionChoice::kConstantTwist);
  EXPECT_NE(slow.text().find("less than 50 Hz"), std::string::npos) << slow.text();
  EXPECT_EQ(gyro_alone.choice(), MotionChoice::kConstantTwist);
  EXPECT_NE(gyro_alone.text().find("no acceleration"), std::string::npos) << gyro_alone.text();
  EXPECT_EQ(none.text(), "constant twist, there is no IMU");
}

TEST(MotionSelection, IsInertialThoughTheFirstMessagesOfADriverAreEmpty) {
  MotionSelection selection{Config()};
  for (int i = 0; i < 10 && selection.isOpen(); ++i)
    selection.note(i < 2 ? gyro(0.01 * i) : accelerated(0.01 * i));
  EXPECT_TRUE(selection.isInertial()) << selection.text();
  MotionSelection short_one{Config()};
  short_one.note(gyro(0.0));
  short_one.close();
  EXPECT_NE(short_one.text().find("no acceleration"), std::string::npos) << short_one.text();
}

// A frame with a stamp that is none, and a reset while nothing has decided.
TEST(MotionSelection, IsNotDecidedByAResetThatComesFirst) {
  for (const bool is_stale : {true, false}) {
    SlamSystem system{Config()};
    system.setRig(exampleRig());
    system.add(StereoFrame{is_stale ? 1 : fromSeconds(99.9), {}});
    if (!is_stale) system.reset("somebody wants it");
    for (int i = 0; i < 20; ++i) system.add(accelerated(100.0 + 0.005 * i));
    EXPECT_EQ(system.motion(), MotionChoice::kInertial) << system.motionText();
  }
}

// Whose driver starts some seconds after that of the cameras.
TEST(MotionSelection, IsInertialOnceAnImuComesThatWasLate) {
  SlamSystem system{Config()};
  std::vector<std::string> resets;
  system.onReset([&](const std::string& reason, const PathEstimate&) { resets.push_back(reason); });
  system.setRig(exampleRig());
  Street street(1, 40);
  for (int i = 0; i < 60; ++i) {
    const double t = 100.0 + 0.1 * i;
    if (i == 40) {
      EXPECT_EQ(system.motionText(), "constant twist, there is no IMU");
    }
    for (int k = 0; i > 40 && k < 20; ++k) system.add(accelerated(t + 0.005 * (k - 19)));
    system.add(street.frame(fromSeconds(t), SE3(), 0.1));
  }
  EXPECT_EQ(system.motion(), MotionChoice::kInertial);
  EXPECT_EQ(resets, std::vector<std::string>{"an IMU with accelerations has come"});
  system.flush();
  EXPECT_TRUE(system.estimator().hasStarted()) << system.estimator().startProblem();
}

TEST(MotionSelection, TellsOfItsDecisionOnceAndKeepsToIt) {
  MotionSelection selection{Config()};
  int told = 0;
  selection.onDecision([&] { told += selection.isOpen() ? 100 : 1; });
  for (int i = 0; i < 3; ++i) selection.note(gyro(0.01 * i));
  selection.decide(MotionChoice::kInertial, "to try");
  for (int i = 3; i < 12; ++i) selection.note(accelerated(0.01 * i));
  selection.close();
  EXPECT_EQ(told, 1);
  EXPECT_EQ(selection.choice(), MotionChoice::kConstantTwist);
  EXPECT_NE(selection.text().find("no acceleration"), std::string::npos) << selection.text();
}

TEST(MotionSelection, IsWhatIsConfiguredWhateverComes) {
  Config config;
  config.invariant.choice = MotionChoice::kInertial;
  EXPECT_EQ(MotionSelection(config).text(), "inertial, configured");
  MotionSelection selection(config);
  selection.onDecision([] { ADD_FAILURE() << "the configuration has decided"; });
  selection.note(gyro(0.0));
  selection.close();
  EXPECT_TRUE(selection.isInertial());
  config.estimator = EstimatorType::kPaper;
  EXPECT_EQ(MotionSelection(config).choice(), MotionChoice::kConstantTwist);
  EXPECT_EQ(MotionSelection(config).text(), "");
}

} // namespace
} // namespace vi_ekf_slam

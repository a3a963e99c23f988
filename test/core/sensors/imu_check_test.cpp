#include "vi_ekf_slam/core/sensors/imu_check.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "../numeric.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {
namespace {

using Said = std::vector<std::string>;

constexpr double kGravity = 9.81; // m/s^2

ImuSample sampleAt(double t, const std::optional<Eigen::Vector3d>& acceleration) {
  return {fromSeconds(t), Eigen::Vector3d::Zero(), {}, acceleration, {}};
}

/// What is said of samples at these times.
Said saidOf(ImuCheck& check, const std::vector<double>& times,
            const std::optional<Eigen::Vector3d>& acceleration = Eigen::Vector3d(0.0, 0.0, kGravity),
            bool inertial = true) {
  Said said;
  check.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (const double t : times) {
    check.arrived(fromSeconds(t));
    check.note(sampleAt(t, acceleration), inertial);
  }
  return said;
}

std::vector<double> regular(double from, double to, double period) {
  std::vector<double> times;
  for (int i = 0; from + period * i < to; ++i) times.push_back(from + period * i);
  return times;
}

bool contains(const Said& said, const std::string& part) {
  return said.size() == 1 && said[0].find(part) != std::string::npos;
}

TEST(ImuCheck, SaysNothingOfAnImuThatIsWell) {
  for (const double period : {0.0025, 0.01, 0.1}) {
    ImuCheck check(kGravity);
    EXPECT_EQ(saidOf(check, regular(0.0, 20.0, period)), Said());
    check.noteFrame(fromSeconds(20.0));
    EXPECT_EQ(check.problem(), "");
    EXPECT_EQ(check.counts().stutters + check.counts().backwards + check.counts().stops, 0U);
  }
}

TEST(ImuCheck, SaysOnceThatItStuttersAndCountsEachInterval) {
  ImuCheck check(kGravity);
  std::vector<double> times = regular(0.0, 1.0, 0.01); // the usual one is known then
  for (int i = 0; i < 50; ++i) {
    for (const double dt : {0.01, 0.01, 0.03}) times.push_back(times.back() + dt);
  }
  const Said said = saidOf(check, times);
  EXPECT_TRUE(contains(said, "samples are 10 to 30 ms apart, mostly 10")) << ::testing::PrintToString(said);
  EXPECT_EQ(check.counts().stutters, 50U);
  EXPECT_EQ(check.problem(), said[0]);
  EXPECT_EQ(saidOf(check, regular(times.back() + 0.01, times.back() + 2.0, 0.01)), Said());
  EXPECT_EQ(check.problem(), "") << "it is well again";
}

TEST(ImuCheck, SaysThatSamplesAreLostInHoles) {
  ImuCheck check(kGravity);
  std::vector<double> times = regular(0.0, 1.0, 0.005);
  for (int i = 0; i < 10; ++i) {
    times.push_back(times.back() + 0.1);
    for (int k = 0; k < 50; ++k) times.push_back(times.back() + 0.005);
  }
  EXPECT_TRUE(contains(saidOf(check, times),
                       "samples are 5 to 100 ms apart, mostly 5; more than one in ten, or a quarter"));
}

TEST(ImuCheck, CountsALostSampleWithoutAWord) {
  ImuCheck check(kGravity);
  std::vector<double> times = regular(0.0, 2.0, 0.01);
  times.erase(times.begin() + 150);
  EXPECT_EQ(saidOf(check, times), Said());
  EXPECT_EQ(check.counts().stutters, 1U);
}

TEST(ImuCheck, SaysOnceThatStampsGoBack) {
  ImuCheck check(kGravity);
  Said said;
  check.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (const double t : {1.0, 1.01, 0.96, 1.02, 1.01, 1.03}) check.arrived(fromSeconds(t));
  EXPECT_TRUE(contains(said, "go back by 0.05 s")) << ::testing::PrintToString(said);
  EXPECT_EQ(check.counts().backwards, 2U);
  check.restart();
  check.arrived(fromSeconds(0.0));
  EXPECT_EQ(check.counts().backwards, 2U) << "time begins anew";
}

TEST(ImuCheck, SaysWhenItStopsWhileFramesGoOnAndWhenItIsBack) {
  ImuCheck check(kGravity);
  Said said = saidOf(check, regular(0.0, 2.0, 0.01));
  check.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (double t = 2.0; t < 3.0; t += 0.1) check.noteFrame(fromSeconds(t));
  EXPECT_TRUE(contains(said, "the IMU has stopped: no sample for 0.51 s")) << ::testing::PrintToString(said);
  EXPECT_EQ(check.problem(), said[0]);
  check.note(sampleAt(3.0, Eigen::Vector3d(0.0, 0.0, kGravity)), true);
  EXPECT_EQ(said.size(), 2U);
  EXPECT_EQ(check.problem(), "");
  EXPECT_EQ(check.counts().stops, 1U);
}

TEST(ImuCheck, TellsSamplesThatComeTooLateFromNone) {
  ImuCheck check(kGravity);
  Said said = saidOf(check, regular(0.0, 2.0, 0.01));
  check.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (double t = 2.5; t < 3.0; t += 0.1) {
    check.arrived(fromSeconds(t - 0.4)); // and is dropped
    check.noteFrame(fromSeconds(t));
  }
  EXPECT_TRUE(contains(said, "after frames that are 0.4 s newer")) << ::testing::PrintToString(said);
  EXPECT_FALSE(contains(said, "stopped"));
}

TEST(ImuCheck, DoesNotTakeASlowImuForOneThatStops) {
  ImuCheck check(kGravity);
  EXPECT_EQ(saidOf(check, regular(0.0, 10.0, 0.2)), Said());
  for (double t = 10.0; t < 10.7; t += 0.1) check.noteFrame(fromSeconds(t));
  EXPECT_EQ(check.counts().stops, 0U);
}

TEST(ImuCheck, DoesNotTakeAGapOfBothForAnImuThatStops) {
  ImuCheck check(kGravity);
  EXPECT_EQ(saidOf(check, regular(0.0, 2.0, 0.01)), Said());
  check.noteFrame(fromSeconds(2.0));
  check.noteFrame(fromSeconds(7.0));
  EXPECT_EQ(saidOf(check, regular(7.0, 8.0, 0.01)), Said());
  EXPECT_EQ(check.counts().stops, 0U);
  EXPECT_EQ(check.counts().stutters, 0U);
}

TEST(ImuCheck, NamesAccelerationsThatAreNone) {
  const auto said = [](const std::optional<Eigen::Vector3d>& acceleration, bool inertial = true) {
    ImuCheck check(kGravity);
    return saidOf(check, regular(0.0, 3.0, 0.01), acceleration, inertial);
  };
  EXPECT_TRUE(contains(said(Eigen::Vector3d(0.0, 0.6, 0.8)), "mean of 1 over 1 s, allowed: 2.94 to 29.4"));
  EXPECT_TRUE(contains(said(Eigen::Vector3d(0.0, 0.6, 0.8)), "are they in g?"));
  EXPECT_TRUE(contains(said(Eigen::Vector3d(0.02, 0.0, 0.01)), "gravity is missing"));
  EXPECT_TRUE(contains(said(Eigen::Vector3d(0.0, 0.0, 981.0)), "another unit"));
  EXPECT_TRUE(contains(said(std::nullopt), "carry no acceleration"));
  EXPECT_EQ(said(std::nullopt, false), Said()) << "nobody asks for it";
  EXPECT_EQ(said(Eigen::Vector3d(0.0, 8.0, 8.0)), Said());
}

/// What is said of 60 s of these rates (rad/s) and accelerations (m/s^2) along x, beside gravity.
template <class Rate, class Acceleration>
Said saidOfMotion(const Rate& rate, const Acceleration& acceleration) {
  ImuCheck check(kGravity);
  Said said;
  check.onProblem([&said](const std::string& text) { said.push_back(text); });
  for (int i = 0; i < 12000; ++i) {
    const double t = 0.005 * i;
    ImuSample sample = sampleAt(t, Eigen::Vector3d(acceleration(t), 0.0, kGravity));
    sample.angular_velocity.x() = rate(t);
    check.arrived(sample.stamp);
    check.note(sample, true);
  }
  EXPECT_EQ(check.problem(), said.empty() ? "" : said.back());
  return said;
}

double nothing(double /*t*/) { return 0.0; }

TEST(ImuCheck, SaysOnceThatItIsSaturated) {
  test::Random random(1);
  const auto turning = [&random](double t) {
    const double noisy = 2.0 * std::sin(3.0 * t) * std::sin(t) + random.gaussian<1>(0.002)[0];
    return std::clamp(0.001 * std::round(1e3 * noisy), -0.5, 0.5);
  };
  const auto shaken = [&random](double /*t*/) {
    return std::clamp(random.gaussian<1>(25.0)[0], -19.6, 19.6);
  };
  EXPECT_TRUE(contains(saidOfMotion(turning, nothing), "the gyro is saturated at 0.5 rad/s (its x axis)"));
  EXPECT_TRUE(contains(saidOfMotion(nothing, shaken), "the accelerometer is saturated at 19.6 m/s^2"));
}

TEST(ImuCheck, DoesNotTakeCoarseNumbersForASaturatedOne) {
  test::Random random(1);
  const auto none = [](const auto& rate) { return saidOfMotion(rate, rate) == Said(); };
  for (const double sigma : {0.0, 0.1, 0.3, 0.5, 1.0, 3.0, 10.0}) { // of the quantum
    for (const double bias : {0.0, 0.25, 0.5}) {
      EXPECT_TRUE(none([&](double) { return std::round(bias + random.gaussian<1>(sigma)[0]) / 64.0; }))
          << sigma << " " << bias;
      const auto rocking = [&](double t) {
        return std::round(100.0 * std::sin(3.0 * t) + random.gaussian<1>(sigma)[0]) / 64.0;
      };
      EXPECT_TRUE(none(rocking)) << sigma;
    }
    double held = 0.0;
    int count = 0;
    EXPECT_TRUE(none([&](double) {
      if (count++ % 4 == 0) held = std::round(3.0 * random.gaussian<1>(sigma)[0]) / 64.0;
      return held;
    })) << sigma
        << ": a driver that repeats each";
  }
}

// A robot in a simulator without noise.
TEST(ImuCheck, DoesNotTakeAnEvenTurnForASaturatedOne) {
  const auto turning = [](double t) { return std::clamp(10.0 * (std::fmod(t, 10.0) - 5.0), 0.0, 0.5); };
  EXPECT_EQ(saidOfMotion(turning, nothing), Said());
}

/// An inertial system at rest, in the dark, that begins from a given state.
class StoppedImu : public ::testing::Test {
 protected:
  StoppedImu() : system_(config()) {
    InitialState state;
    state.stamp = fromSeconds(1.0);
    state.covariance.diagonal().setConstant(1e-4);
    system_.begin(state);
    system_.setRig({});
    system_.onProblem([this](const std::string& text) { said_.push_back(text); });
    system_.onFrame([this](const Output& output) { frames_.push_back(output.state); });
  }

  static Config config() {
    Config config;
    config.invariant.choice = MotionChoice::kInertial;
    return config;
  }

  SlamSystem system_;
  Said said_;
  std::vector<StateEstimate> frames_;
};

TEST_F(StoppedImu, IsNamedAndTheEstimateGoesOnWithAGrowingCovariance) {
  for (int i = 0; i < 600; ++i) {
    const double t = 1.0 + 0.01 * i;
    if (t < 3.0) system_.add(sampleAt(t, Eigen::Vector3d(0.0, 0.0, kGravity)));
    if (i % 10 == 0) system_.add(StereoFrame{fromSeconds(t), {}});
  }
  system_.flush();
  ASSERT_EQ(frames_.size(), 60U);
  EXPECT_TRUE(contains(said_, "the IMU has stopped")) << ::testing::PrintToString(said_);
  EXPECT_EQ(system_.checks().imu.counts().stops, 1U);
  const auto sigma = [this](std::size_t i) {
    return std::sqrt(frames_[i].pose_covariance.topLeftCorner<3, 3>().trace());
  };
  const double with_imu = sigma(19) - sigma(10), without = sigma(29) - sigma(20),
               later = sigma(49) - sigma(40);
  EXPECT_GT(without, 5.0 * with_imu);
  EXPECT_GT(later, 2.0 * without);
  EXPECT_TRUE(frames_.back().world_T_imu.matrix().allFinite());
}

} // namespace
} // namespace vi_ekf_slam

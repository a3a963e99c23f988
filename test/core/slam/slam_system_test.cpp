#include "vi_ekf_slam/core/slam/slam_system.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "../system_drive.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(SlamSystem, OutOfOrderArrivalGivesIdenticalResults) {
  const auto in_order = drive(100.0, 4.0);
  const Record expected = run(in_order);
  Random random(2);
  for (int trial = 0; trial < 10; ++trial) {
    // Each stream with its own delay below 90 ms, as long as it lasts and in its own order.
    std::vector<std::pair<Stamp, std::size_t>> arrival;
    std::array<Stamp, kStreamCount> last{};
    for (std::size_t i = 0; i < in_order.size(); ++i) {
      Stamp& stream_last = last[static_cast<std::size_t>(streamOf(in_order[i]))];
      const auto latency = static_cast<Stamp>(random.uniform(0.0, 90e6));
      stream_last = std::max(stream_last + 1, stampOf(in_order[i]) + latency);
      arrival.emplace_back(stream_last, i);
    }
    std::sort(arrival.begin(), arrival.end());
    std::vector<Measurement> shuffled;
    for (const auto& [at, i] : arrival) shuffled.push_back(in_order[i]);
    expectSame(run(shuffled), expected);
  }
}

TEST(SlamSystem, HandlersAreCalledInTheOrderOfStampsOncePerMeasurement) {
  const Record record = run(drive(100.0, 1.0));
  std::vector<std::string> expected;
  for (const auto& m : drive(100.0, 1.0)) {
    if (streamOf(m) == Stream::kImu) expected.push_back("gyro " + std::to_string(stampOf(m)));
    if (streamOf(m) == Stream::kStereo) expected.push_back("frame " + std::to_string(stampOf(m)));
  }
  EXPECT_EQ(record.events, expected);
}

TEST(SlamSystem, OdomIsDeadReckoningAndTheStateIsTheEstimators) {
  const auto measurements = drive(100.0, 2.0);
  const Record record = run(measurements);

  DeadReckoning dead_reckoning;
  const auto estimator = makeEstimator(makeConfig(PaperMode::kSlam));
  estimator->setRig(exampleRig());
  std::size_t i = 0;
  for (const auto& m : measurements) {
    std::visit([&](const auto& sample) { estimator->process(sample); }, m);
    if (const auto* g = std::get_if<ImuSample>(&m)) dead_reckoning.process(*g);
    if (const auto* v = std::get_if<VelocitySample>(&m)) dead_reckoning.process(*v);
    dead_reckoning.advanceTo(stampOf(m));
    if (streamOf(m) == Stream::kVelocity) continue;
    ASSERT_LT(i, record.outputs.size());
    const Output& output = record.outputs[i++];
    EXPECT_EQ(distance(output.odom_T_imu.matrix(), dead_reckoning.pose().matrix()), 0.0);
    EXPECT_EQ(distance(output.state.world_T_imu.matrix(), estimator->state().world_T_imu.matrix()), 0.0);
  }
  EXPECT_EQ(i, record.outputs.size());
  EXPECT_GT(
      distance(record.outputs.back().odom_T_imu.matrix(), record.outputs.back().state.world_T_imu.matrix()),
      1e-4)
      << "the camera never corrected anything";
}

TEST(SlamSystem, CountsLateAndDuplicateMeasurementsOfEachStream) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  system.setRig(exampleRig());
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  system.flush();
  const auto processed = system.counts().processed;
  EXPECT_EQ(processed[kGyro], 100U);
  EXPECT_EQ(processed[kVelocity], 50U);
  EXPECT_EQ(processed[kStereo], 10U);
  system.add(gyro(100.5));                           // older than the last handed out
  system.add(StereoFrame{fromSeconds(100.2), {}});   // likewise
  system.add(StereoFrame{fromSeconds(100.205), {}}); // likewise
  system.add(velocity(101.0));                       // held
  system.add(velocity(101.0));                       // the same again
  system.flush();
  EXPECT_EQ(system.counts().late[kGyro], 1U);
  EXPECT_EQ(system.counts().late[kVelocity], 0U);
  EXPECT_EQ(system.counts().late[kStereo], 2U);
  EXPECT_EQ(system.counts().duplicate[kGyro], 0U);
  EXPECT_EQ(system.counts().duplicate[kVelocity], 1U);
  EXPECT_EQ(system.counts().processed[kGyro], 100U);
  EXPECT_EQ(system.counts().processed[kVelocity], 51U);
  EXPECT_EQ(system.counts().processed[kStereo], 10U);
  EXPECT_EQ(system.counts().resets, 0U);
}

TEST(SlamSystem, DropsAndCountsValuesThatAreNotFinite) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  system.setRig(exampleRig());
  std::size_t n = 0;
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < 3; ++i) {
      ImuSample g = gyro(100.0 + 0.01 * static_cast<double>(n));
      VelocitySample v = velocity(100.0 + 0.01 * static_cast<double>(n));
      g.angular_velocity[i] = bad;
      v.linear_velocity[i] = bad;
      system.add(g);
      system.add(v);
      ++n;
      EXPECT_EQ(system.counts().invalid[kGyro], n);
      EXPECT_EQ(system.counts().invalid[kVelocity], n);
    }
  }
  system.flush();
  EXPECT_EQ(total(system.counts().processed), 0U);
}

TEST(SlamSystem, DropsAndCountsMotionThatIsTooFastToBeOne) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  system.setRig(exampleRig());
  std::size_t n = 0;
  for (const double bad : {1.001e3, 1e30, 1e308, -1e308}) {
    ImuSample g = gyro(100.0 + 0.01 * static_cast<double>(n));
    VelocitySample v = velocity(100.0 + 0.01 * static_cast<double>(n));
    g.angular_velocity.y() = bad;
    v.linear_velocity.z() = bad;
    system.add(g);
    system.add(v);
    ++n;
    EXPECT_EQ(system.counts().invalid[kGyro], n) << bad;
    EXPECT_EQ(system.counts().invalid[kVelocity], n) << bad;
  }
  system.add(ImuSample{fromSeconds(101.0), {0.0, 0.0, kMaxAngularSpeed}, {}});
  system.add(VelocitySample{fromSeconds(101.0), {-kMaxSpeed, 0.0, 0.0}, {}});
  system.flush();
  EXPECT_EQ(system.counts().processed[kGyro], 1U);
  EXPECT_EQ(system.counts().processed[kVelocity], 1U);
}

TEST(SlamSystem, AbsurdValuesLeaveTheStateFinite) {
  for (const PaperMode mode : {PaperMode::kMapping, PaperMode::kSlam}) {
    SlamSystem system(makeConfig(mode));
    system.setRig(exampleRig());
    std::vector<Measurement> measurements = drive(100.0, 2.0);
    for (Measurement& m : measurements) {
      const double t = toSeconds(stampOf(m)) + 0.001;
      if (auto* frame = std::get_if<StereoFrame>(&m); frame != nullptr && t > 101.0) {
        for (auto& feature : frame->features) feature.pixels *= 1e200;
      }
      system.add(m);
      system.add(ImuSample{fromSeconds(t), {0.0, 1e308, 1e308}, {}});
      system.add(VelocitySample{fromSeconds(t), {1e308, 0.0, -1e308}, {}});
    }
    system.flush();
    EXPECT_GT(system.counts().features_used, 0U);
    EXPECT_GT(system.counts().features_invalid, 0U);
    const StateEstimate state = system.estimator().state();
    EXPECT_TRUE(state.world_T_imu.matrix().allFinite());
    EXPECT_TRUE(state.pose_covariance.allFinite());
    for (const auto& landmark : system.estimator().landmarks()) EXPECT_TRUE(landmark.position.allFinite());
  }
}

TEST(SlamSystem, DropsAndCountsCovariancesThatAreNone) {
  Eigen::Matrix3d indefinite = Eigen::Matrix3d::Identity(), asymmetric = indefinite, not_finite = indefinite;
  indefinite(2, 2) = -1e-6;
  asymmetric(0, 1) = 0.1;
  not_finite(1, 2) = std::nan("");
  const std::vector<Eigen::Matrix3d> bad{indefinite, asymmetric, not_finite, Eigen::Matrix3d::Zero()};
  SlamSystem system(makeConfig(PaperMode::kSlam));
  system.setRig(exampleRig());
  for (std::size_t i = 0; i < bad.size(); ++i) {
    ImuSample g = gyro(100.0 + 0.01 * static_cast<double>(i));
    VelocitySample v = velocity(100.0 + 0.01 * static_cast<double>(i));
    g.covariance = bad[i];
    v.covariance = bad[i];
    system.add(g);
    system.add(v);
    EXPECT_EQ(system.counts().invalid[kGyro], i + 1);
    EXPECT_EQ(system.counts().invalid[kVelocity], i + 1);
    EXPECT_EQ(system.counts().bad_covariance[kGyro], i + 1);
  }
  Eigen::Matrix3d good;
  good << 2.0, 0.5, 0.1, 0.5, 1.0, 0.2, 0.1, 0.2, 3.0;
  ImuSample g = gyro(100.5);
  g.covariance = good * 1e-12; // small is no fault
  system.add(g);
  system.flush();
  EXPECT_EQ(system.counts().invalid[kGyro], bad.size());
  EXPECT_EQ(system.counts().processed[kGyro], 1U);
}

TEST(SlamSystem, AnInvalidMeasurementLeavesNoTrace) {
  auto measurements = drive(100.0, 1.0);
  const Record expected = run(measurements);
  SlamSystem system(makeConfig(PaperMode::kSlam));
  Record record;
  record.listenTo(system);
  system.setRig(exampleRig());
  for (const auto& m : measurements) {
    ImuSample bad = gyro(1e6); // from the far future, too
    bad.angular_velocity.x() = std::nan("");
    system.add(bad);
    system.add(m);
  }
  system.flush();
  EXPECT_EQ(system.counts().invalid[kGyro], measurements.size());
  expectSame(record, expected);
}

TEST(SlamSystem, AJumpBackFlushesThenResetsThenStartsAnew) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  Record record;
  record.listenTo(system);
  system.setRig(exampleRig());
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  const std::size_t before = record.events.size();
  ASSERT_LT(before, 110U) << "something has to be held for this test";
  ASSERT_FALSE(system.estimator().landmarks().empty());

  system.add(gyro(50.0));
  ASSERT_EQ(record.events.size(), 111U);
  EXPECT_EQ(record.events[109], "gyro 100990000000") << "what was held is told first";
  EXPECT_EQ(record.events[110], "reset");
  ASSERT_EQ(record.reasons.size(), 1U);
  EXPECT_NE(record.reasons[0].find("time jumped back by 50.99"), std::string::npos) << record.reasons[0];
  EXPECT_EQ(system.counts().resets, 1U);
  EXPECT_TRUE(system.hasRig()) << "the calibration stays";
  EXPECT_TRUE(system.estimator().landmarks().empty());
  EXPECT_EQ(distance(system.estimator().state().world_T_imu.matrix(), Eigen::Matrix4d::Identity()), 0.0);
  EXPECT_EQ(total(system.counts().processed), 160U) << "the counts stay";

  system.flush();
  EXPECT_EQ(record.events.back(), "gyro 50000000000")
      << "the measurement that jumped is the first of the new start";
}

TEST(SlamSystem, AfterAResetEverythingIsAsAtTheFirstStart) {
  const auto measurements = drive(100.0, 2.0);
  const Record expected = run(measurements);
  SlamSystem system(makeConfig(PaperMode::kSlam));
  system.setRig(exampleRig());
  for (const auto& m : drive(500.0, 2.0)) system.add(m);
  Record record;
  system.reset("asked to");
  record.listenTo(system);
  for (const auto& m : measurements) system.add(m);
  system.flush();
  expectSame(record, expected);
}

TEST(SlamSystem, ResetTellsItsReason) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  Record record;
  record.listenTo(system);
  system.reset("asked to");
  EXPECT_EQ(record.reasons, std::vector<std::string>{"asked to"});
  EXPECT_EQ(system.counts().resets, 1U);
}

TEST(SlamSystem, FlushProcessesAllThatIsHeldAndNothingTwice) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  EXPECT_EQ(total(system.counts().processed), 0U);
  system.flush();
  EXPECT_EQ(total(system.counts().processed), 160U);
  system.flush();
  EXPECT_EQ(total(system.counts().processed), 160U);
}

TEST(SlamSystem, WorksWithoutListeners) {
  SlamSystem system(makeConfig(PaperMode::kMapping));
  system.setRig(exampleRig());
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  system.add(gyro(1.0));
  system.flush();
  EXPECT_EQ(system.counts().resets, 1U);
  EXPECT_EQ(total(system.counts().processed), 161U);
}

TEST(SlamSystem, ReckonsOnWithNoVelocityThatHasStoppedComing) {
  Config config;
  config.estimator = EstimatorType::kInvariant;
  SlamSystem system(config);
  system.setRig(exampleRig());
  Output last;
  system.onImu([&](const Output& output) { last = output; });
  Street street(1, 40);
  for (int i = 0; i < 6000; ++i) {
    const double t = 100.0 + 0.01 * i;
    ImuSample still = gyro(t);
    still.angular_velocity.setZero();
    if (i < 2) system.add(velocity(t)); // at rest all the same
    system.add(still);
    if (i % 10 == 0) system.add(street.frame(fromSeconds(t), SE3(), 0.1));
  }
  system.flush();
  EXPECT_LT(last.odom_T_imu.translation().norm(), 6.0); // 120 m with the velocity of the first moment
  EXPECT_LT(last.state.world_T_imu.translation().norm(), 3.0);
}

TEST(SlamSystem, TellsOfAFrameWithTheStampThatItCameWith) {
  Config config;
  config.estimator = EstimatorType::kInvariant;
  config.invariant.rig.time_offset = 0.0123456789;
  SlamSystem system(config);
  system.setRig(exampleRig());
  std::vector<Stamp> came, told;
  system.onFrame([&](const Output& output) {
    told.push_back(output.frame_stamp);
    EXPECT_EQ(output.state.stamp - output.frame_stamp, fromSeconds(config.invariant.rig.time_offset));
  });
  for (const auto& m : drive(100.0, 2.0)) {
    if (std::holds_alternative<StereoFrame>(m)) came.push_back(stampOf(m));
    system.add(m);
  }
  system.flush();
  EXPECT_GT(told.size(), 10u);
  EXPECT_EQ(came, told);
}

TEST(SlamSystem, FeatureCountsAreTheSumsOfTheReports) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  std::size_t features = 0, used = 0, invalid = 0, rejected = 0;
  system.onFrame([&](const Output& output) {
    features += output.report.features;
    used += output.report.used;
    invalid += output.report.invalid;
    rejected += output.report.rejected;
  });
  system.setRig(exampleRig());
  auto measurements = drive(100.0, 2.0);
  for (auto& m : measurements) {
    auto* frame = std::get_if<StereoFrame>(&m);
    if (frame != nullptr) frame->features.push_back({1000, StereoPixels::Constant(-1.0)});
    system.add(m);
  }
  system.flush();
  EXPECT_EQ(system.counts().features, features);
  EXPECT_EQ(system.counts().features_used, used);
  EXPECT_EQ(system.counts().features_invalid, invalid);
  EXPECT_EQ(system.counts().features_rejected, rejected);
  EXPECT_GE(invalid, 20U);
  EXPECT_GT(used, 50U);
}

} // namespace
} // namespace vi_ekf_slam

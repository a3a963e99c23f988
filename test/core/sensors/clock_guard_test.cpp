#include "vi_ekf_slam/core/sensors/clock_guard.hpp"

#include <gtest/gtest.h>

#include "../system_drive.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

Config guardedConfig() {
  Config config = makeConfig(PaperMode::kSlam);
  config.buffer.jump_confirmations = 5;
  config.buffer.max_jump_s = 1.0;
  config.buffer.max_gap_s = 30.0;
  return config;
}

/// What remains of `measurements` when all counts of loss are taken together.
void expectNothingLost(const SystemCounts& counts, std::size_t measurements) {
  EXPECT_EQ(total(counts.late) + total(counts.duplicate) + total(counts.ahead) + total(counts.behind), 0U);
  EXPECT_EQ(total(counts.processed), measurements);
}

TEST(ClockGuard, StampsThatAreWrongByThemselvesAreDroppedAndCountedAndLeaveNoTrace) {
  const auto measurements = drive(100.0, 1.0);
  const Record expected = run(measurements);
  SlamSystem system(guardedConfig());
  Record record;
  record.listenTo(system);
  system.setRig(exampleRig());
  std::size_t n = 0;
  for (const auto& m : measurements) {
    if (++n == 50) {
      system.add(gyro(4e9));    // far ahead
      system.add(velocity(90)); // far behind
      system.add(gyro(102.5));  // a little ahead, still by itself
    }
    system.add(m);
  }
  system.flush();
  EXPECT_EQ(system.counts().ahead[kGyro], 2U);
  EXPECT_EQ(system.counts().behind[kVelocity], 1U);
  EXPECT_EQ(system.counts().resets, 0U);
  expectSame(record, expected);
}

TEST(ClockGuard, AStreamOnAnotherClockIsDroppedAndTheOthersGoOn) {
  for (const double offset : {-5000.0, 5000.0}) {
    SlamSystem system(guardedConfig());
    system.setRig(exampleRig());
    for (auto m : drive(10000.0, 2.0)) {
      if (auto* frame = std::get_if<StereoFrame>(&m)) frame->stamp += fromSeconds(offset);
      system.add(m);
    }
    system.flush();
    const SystemCounts c = system.counts();
    EXPECT_EQ(c.resets, 0U);
    EXPECT_EQ(offset > 0.0 ? c.ahead[kStereo] : c.behind[kStereo], 20U);
    EXPECT_EQ(c.processed[kGyro], 200U);
  }
}

TEST(ClockGuard, AStreamOnAnotherClockThatComesFirstIsDroppedAndTheOthersGoOn) {
  for (const double offset : {-5000.0, 5000.0}) {
    SlamSystem system(guardedConfig());
    system.setRig(exampleRig());
    system.add(velocity(10000.0 + offset));
    std::size_t n = 0;
    for (const auto& m : drive(10000.0, 2.0)) {
      // As often as all the others together, so that these never are alone for long.
      system.add(velocity(10000.0 + offset + 0.01 * static_cast<double>(++n)));
      if (streamOf(m) != Stream::kVelocity) system.add(m);
    }
    system.flush();
    const SystemCounts c = system.counts();
    EXPECT_EQ(c.processed[kGyro], 200U);
    EXPECT_EQ(c.processed[kStereo], 20U);
    EXPECT_EQ(offset > 0.0 ? c.ahead[kVelocity] : c.behind[kVelocity], n - 1);
    EXPECT_EQ(c.resets, 1U);
  }
}

TEST(ClockGuard, ASensorWhoseWrongClockStandsStillConfirmsNothing) {
  SlamSystem system(guardedConfig());
  system.setRig(exampleRig());
  for (const auto& m : drive(100.0, 1.0)) {
    system.add(m);
    for (int i = 0; i < 6; ++i) system.add(gyro(3000.0));
  }
  system.flush();
  EXPECT_EQ(system.counts().resets, 0U);
  EXPECT_EQ(total(system.counts().processed), 160U);
}

TEST(ClockGuard, AGapOfSecondsIsBridgedWithoutLoss) {
  SlamSystem system(guardedConfig());
  system.setRig(exampleRig());
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  for (const auto& m : drive(110.0, 1.0)) system.add(m);
  system.flush();
  EXPECT_EQ(system.counts().gaps, 1U);
  EXPECT_EQ(system.counts().resets, 0U);
  expectNothingLost(system.counts(), 320U);
  EXPECT_TRUE(system.estimator().state().world_T_imu.matrix().allFinite());
}

TEST(ClockGuard, ALongGapAndAClockThatRestartsBeginAnewWithoutLoss) {
  for (const double second : {50.0, 200.0}) {
    SlamSystem system(guardedConfig());
    Record record;
    record.listenTo(system);
    system.setRig(exampleRig());
    for (const auto& m : drive(100.0, 1.0)) system.add(m);
    for (const auto& m : drive(second, 1.0)) system.add(m);
    system.flush();
    EXPECT_EQ(system.counts().resets, 1U);
    EXPECT_EQ(system.counts().gaps, 0U);
    expectNothingLost(system.counts(), 320U);
    ASSERT_EQ(record.reasons.size(), 1U);
    EXPECT_NE(record.reasons[0].find(second > 100.0 ? "time jumped ahead by 99" : "time jumped back by 50.9"),
              std::string::npos)
        << record.reasons[0];
  }
}

TEST(ClockGuard, AStreamThatWasHeldUpIsLateAndNothingBeginsAnew) {
  for (const Stream held_up : {Stream::kStereo, Stream::kImu}) {
    SlamSystem system(guardedConfig());
    system.setRig(exampleRig());
    std::vector<Measurement> waiting;
    const auto measurements = drive(100.0, 10.0);
    for (const auto& m : measurements) {
      const double t = toSeconds(stampOf(m)) - 100.0;
      if (streamOf(m) == held_up && t > 3.0 && t < 6.0) {
        waiting.push_back(m);
        continue;
      }
      if (streamOf(m) == held_up) {
        for (const auto& w : std::exchange(waiting, {})) system.add(w);
      }
      system.add(m);
    }
    system.flush();
    EXPECT_EQ(system.counts().resets, 0U);
    EXPECT_EQ(total(system.counts().late) + total(system.counts().processed), measurements.size());
  }
}

TEST(ClockGuard, WhatNothingConfirmedBeforeTheEndIsStray) {
  SlamSystem system(guardedConfig());
  system.setRig(exampleRig());
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  for (int i = 0; i < 4; ++i) system.add(gyro(200.0 + 0.01 * i));
  system.flush();
  EXPECT_EQ(system.counts().ahead[kGyro], 4U);
  EXPECT_EQ(system.counts().resets, 0U);
}

} // namespace
} // namespace vi_ekf_slam

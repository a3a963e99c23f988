// What the first measurements wait for: the calibration, and what is known of the biases.
#include <gtest/gtest.h>

#include "../system_drive.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(SlamSystem, WaitsForTheRigAndThenProcessesWhatItHeld) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  for (const auto& m : drive(100.0, 1.9)) system.add(m);
  EXPECT_EQ(total(system.counts().processed), 0U);
  EXPECT_FALSE(system.hasRig());
  system.setRig(exampleRig());
  EXPECT_TRUE(system.hasRig());
  EXPECT_GT(total(system.counts().processed), 300U - 40U);
  system.flush();
  EXPECT_EQ(total(system.counts().processed), drive(100.0, 1.9).size());
  EXPECT_EQ(system.counts().frames_without_rig, 0U);
  EXPECT_GT(system.counts().features_used, 0U);
}

TEST(SlamSystem, GoesOnWithoutTheRigAfterRigWait) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  double processed_at = 0.0;
  for (const auto& m : drive(100.0, 3.0)) {
    system.add(m);
    if (processed_at == 0.0 && total(system.counts().processed) > 0) processed_at = toSeconds(stampOf(m));
  }
  EXPECT_NEAR(processed_at, 102.0, 0.02);
  system.flush();
  EXPECT_EQ(system.counts().frames_without_rig, 30U);
  EXPECT_EQ(system.counts().features_used, 0U);
  EXPECT_EQ(system.counts().features_invalid, system.counts().features);
  EXPECT_GT(system.counts().features, 0U);
}

TEST(SlamSystem, WaitsForTheRigAgainAfterAJumpBackAndNoLongerThanAtTheStart) {
  SlamSystem system(makeConfig(PaperMode::kSlam));
  for (const auto& m : drive(100.0, 1.0)) system.add(m);
  double processed_at = 0.0;
  for (const auto& m : drive(50.0, 3.0)) {
    system.add(m); // the first of them flushes the 160 from before the jump
    if (processed_at == 0.0 && total(system.counts().processed) > 160) processed_at = toSeconds(stampOf(m));
  }
  EXPECT_EQ(system.counts().resets, 1U);
  EXPECT_NEAR(processed_at, 52.0, 0.02);
}

TEST(SlamSystem, WhatIsKnownOfTheBiasesMayComeAfterTheFirstMeasurements) {
  TwistBias bias;
  bias.mean << 0.01, -0.02, 0.015, 0.03, -0.01, 0.02;
  bias.sigma.setConstant(0.01);
  Config config = makeConfig(PaperMode::kSlam);
  config.estimator = EstimatorType::kInvariant;
  const auto measurements = drive(100.0, 2.0);
  const auto runWith = [&](std::size_t told_at, bool is_awaited) {
    SlamSystem system(config);
    Record record;
    record.listenTo(system);
    system.setRig(exampleRig());
    if (is_awaited) system.awaitBiasPrior();
    for (std::size_t i = 0; i < measurements.size(); ++i) {
      if (i == told_at) system.setBiasPrior(bias);
      system.add(measurements[i]);
    }
    system.flush();
    return record;
  };
  const Record expected = runWith(0, false);
  expectSame(runWith(40, true), expected);
  EXPECT_GT(distance(runWith(40, false).outputs.back().state.world_T_imu.matrix(),
                     expected.outputs.back().state.world_T_imu.matrix()),
            1e-9)
      << "what is known of the biases changes nothing";

  const Record never = runWith(measurements.size(), true);
  ASSERT_FALSE(never.outputs.empty());
  EXPECT_EQ(never.outputs.size(), expected.outputs.size());
}

TEST(SlamSystem, DoesNotWaitForARigThatItsConfigurationDoesNotUse) {
  SlamSystem system(makeConfig(PaperMode::kDeadReckoning));
  for (const auto& m : drive(100.0, 0.5)) system.add(m);
  EXPECT_GT(system.counts().processed[kGyro], 35U);
}

TEST(SlamSystem, HoldsNoMoreThanMaxSizeWhileItWaitsForTheRig) {
  Config config = makeConfig(PaperMode::kSlam);
  config.rig_wait_s = 3600.0;
  config.buffer.max_size = 50;
  SlamSystem system(config);
  std::size_t added = 0;
  for (const auto& m : drive(100.0, 1.0)) {
    system.add(m);
    ++added;
    EXPECT_EQ(total(system.counts().processed), added <= 50 ? 0 : added - 50) << added;
  }
}

TEST(SlamSystem, ARigWaitOfZeroWaitsForNothing) {
  Config config = makeConfig(PaperMode::kSlam);
  config.rig_wait_s = 0.0;
  SlamSystem system(config);
  for (const auto& m : drive(100.0, 0.5)) system.add(m);
  EXPECT_GT(system.counts().processed[kGyro], 35U);
}

} // namespace
} // namespace vi_ekf_slam

#include "vi_ekf_slam/simulation/monte_carlo.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <stdexcept>

namespace vi_ekf_slam::simulation {
namespace {

Config deadReckoning() {
  Config config;
  config.estimator = EstimatorType::kPaper;
  config.paper.mode = PaperMode::kDeadReckoning;
  return config;
}

DriveOptions shortDrive() {
  DriveOptions options = studyOptions(MotionModel::kCarDrive);
  options.duration = 5.0;
  options.features_max = 20;
  options.features_min = 5;
  return options;
}

bool equal(const SeedResult& a, const SeedResult& b) {
  if (a.seed != b.seed || a.frames.size() != b.frames.size() || a.yaw_fall != b.yaw_fall) return false;
  for (std::size_t k = 0; k < a.frames.size(); ++k) {
    const FrameErrors &f = a.frames[k], &g = b.frames[k];
    if (f.nees.pose != g.nees.pose || f.position != g.position || f.dead_reckoning != g.dead_reckoning ||
        f.nis != g.nis || f.nis_dof != g.nis_dof)
      return false;
  }
  return true;
}

TEST(MonteCarlo, ResultsDoNotDependOnTheNumberOfThreads) {
  std::size_t last = 0;
  const auto one = runSeeds(Config(), shortDrive(), 7, 5, 1, [&](std::size_t done) { last = done; });
  const auto three = runSeeds(Config(), shortDrive(), 7, 5, 3);
  ASSERT_EQ(one.size(), 5u);
  EXPECT_EQ(last, 5u);
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].seed, 7 + i);
    EXPECT_EQ(one[i].frames.size(), 50u);
    EXPECT_TRUE(equal(one[i], three[i])) << i;
  }
  EXPECT_FALSE(equal(one[0], one[1]));
}

TEST(MonteCarlo, ADeadReckoningEstimatorIsDeadReckoning) {
  const SeedResult result = runSeed(deadReckoning(), shortDrive());
  for (const FrameErrors& frame : result.frames) EXPECT_NEAR(frame.position, frame.dead_reckoning, 1e-9);
  EXPECT_GT(result.frames.back().dead_reckoning, 0.05);
  EXPECT_GT(rmse(result, &FrameErrors::position), 0.0);
}

// Without noise the errors vanish; a frame taken before its samples or against the pose of the wrong frame
// would show.
TEST(MonteCarlo, ErrorsVanishWithTheNoise) {
  DriveOptions options = shortDrive();
  options.velocity_sigma = options.gyro_sigma = options.gyro_bias_min = options.gyro_bias_max = 0.0;
  for (const double imu_rate : {0.0, 4.0, 100.0}) {
    options.imu_rate = imu_rate;
    for (const FrameErrors& frame : runSeed(deadReckoning(), options).frames) {
      EXPECT_LT(frame.position, 1e-9);
      EXPECT_LT(frame.dead_reckoning, 1e-9);
      EXPECT_LT(frame.nees.pose, 1e-9);
    }
  }
}

TEST(MonteCarlo, MeansAreOverTheSeeds) {
  SeedResult a, b;
  FrameErrors first, second;
  first.nees.pose = 4.0;
  first.position = 3.0;
  first.nis = 10.0;
  first.nis_dof = 5;
  second.nees.pose = 8.0;
  second.position = 1.0;
  second.nis = 2.0;
  second.nis_dof = 1;
  a.frames = {first, first};
  b.frames = {second};
  const auto means = meansByFrame({a, b});
  ASSERT_EQ(means.size(), 1u);
  EXPECT_DOUBLE_EQ(means[0].nees.pose, 6.0);
  EXPECT_DOUBLE_EQ(means[0].position_rmse, std::sqrt(5.0));
  EXPECT_DOUBLE_EQ(means[0].nis_per_dof, 2.0);
  EXPECT_DOUBLE_EQ(nisPerDof(a), 2.0);
  EXPECT_TRUE(std::isnan(nisPerDof(SeedResult())));
}

TEST(MonteCarlo, WhatNeverStartedHasNoErrors) {
  SeedResult never;
  judgePath({}, never);
  for (const double figure : {never.ate, never.smoothed_ate, never.node_nees, never.largest_node_nees,
                              rmse(never, &FrameErrors::smoothed)})
    EXPECT_TRUE(std::isnan(figure));
}

TEST(MonteCarlo, CheckPointsReachTheLastFrame) {
  EXPECT_EQ(checkPointFrame(1.0, 101), 100u);
  EXPECT_EQ(checkPointFrame(0.25, 101), 25u);
  EXPECT_EQ(checkPointFrame(1.0, 1), 0u);
}

TEST(MonteCarlo, AnErrorInAThreadComesOut) {
  DriveOptions options = shortDrive();
  options.features_min = options.features_max + 1;
  EXPECT_THROW(runSeeds(Config(), options, 1, 4, 2), std::invalid_argument);
}

} // namespace
} // namespace vi_ekf_slam::simulation

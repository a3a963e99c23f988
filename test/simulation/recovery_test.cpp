/// The simulated car, displaced and blinded, through the way that the node goes.
#include <gtest/gtest.h>

#include <algorithm>

#include "../sanitized.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/simulation/consistency.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kFault = 40.0; // s after the start
constexpr int kSeeds = kSanitized ? 1 : 6;

struct Fault {
  double skipped_s = 0.0; ///< of the drive: the car is where it would have been so much later, at once
  double blind_s = 0.0;   ///< without any feature
};

struct Result {
  SystemCounts counts;
  std::size_t sent = 0, frames = 0; ///< that went in and came out
  double displacement = 0.0;  ///< m, of the car at the fault
  double nees_after = 0.0;    ///< mean, of the pose, from the end of the fault on; 6 is right
  double last_error = 0.0;    ///< m
  std::size_t used_after = 0; ///< features
  bool finite = true;
};

/// Drives until 40 s after the fault.
Result drive(std::uint64_t seed, const Fault& fault, const Config& config = {}) {
  DriveOptions options;
  options.seed = seed;
  options.duration = kFault + fault.skipped_s + fault.blind_s + 40.0;
  options.stale_fraction = 0.0; // a front end that mixes up its tracks hides the displacement
  DriveSimulator simulator(options);
  SlamSystem system(config);
  system.setRig(simulator.rig());
  Result result;
  SE3 truth;
  Stamp start = 0;
  double nees = 0.0;
  std::size_t after = 0;
  system.onFrame([&](const Output& output) {
    ++result.frames;
    result.finite = result.finite && output.state.pose_covariance.allFinite();
    result.last_error = (truth.translation() - output.state.world_T_imu.translation()).norm();
    if (secondsBetween(start, output.state.stamp) < kFault + fault.blind_s) return;
    result.used_after += output.report.used;
    nees += poseNees(truth, output.state).pose;
    ++after;
  });
  while (auto step = simulator.next()) {
    if (start == 0) start = step->stamp;
    const double time = secondsBetween(start, step->stamp);
    if (time >= kFault && time < kFault + fault.skipped_s) continue;
    const bool past = time >= kFault + fault.skipped_s;
    const Stamp shift = past ? fromSeconds(fault.skipped_s) : 0;
    if (past && result.displacement == 0.0) {
      result.displacement = (step->world_T_imu.translation() - truth.translation()).norm();
    }
    truth = step->world_T_imu;
    if (past && time < kFault + fault.skipped_s + fault.blind_s) step->frame.features.clear();
    ++result.sent;
    for (Measurement& m : measurementsOf(*step)) {
      std::visit([shift](auto& sample) { sample.stamp -= shift; }, m);
      system.add(std::move(m));
    }
    system.flush(); // so that the truth is that of the frame
  }
  result.nees_after = nees / static_cast<double>(after);
  result.counts = system.counts();
  return result;
}

std::uint64_t jumps(const SystemCounts& counts) {
  return counts.divergences[static_cast<std::size_t>(Divergence::kJump)];
}

TEST(DisplacedCar, IsFollowedWithAnHonestCovariance) {
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Result result = drive(seed, {2.2, 0.0});
    EXPECT_GT(result.displacement, 15.0) << seed;
    EXPECT_TRUE(result.finite) << seed;
    EXPECT_GT(result.used_after, 10000U) << seed;
    EXPECT_EQ(jumps(result.counts), 1U) << seed;
    EXPECT_EQ(result.counts.blind_periods, 0U) << seed;
    EXPECT_LT(result.nees_after, 18.5) << seed; // 99.5 % of a chi-square value with 6 degrees of freedom
    EXPECT_LT(result.last_error, 12.0) << seed;
  }
}

TEST(DisplacedCar, IsLostWhereNobodyLooks) {
  Config config;
  config.invariant.recovery.jump_m = 0.0;
  for (std::uint64_t seed = 1; seed <= (kSanitized ? 1 : 2); ++seed) {
    const Result result = drive(seed, {2.2, 0.0}, config);
    EXPECT_EQ(jumps(result.counts), 0U) << seed;
    EXPECT_GT(result.nees_after, 100.0) << seed;
  }
}

TEST(BlindedCar, GoesOnWithAnHonestCovariance) {
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Result blinded = drive(seed, {0.0, 30.0});
    EXPECT_EQ(blinded.counts.blind_periods, 1U) << seed;
    EXPECT_NEAR(blinded.counts.blind_s, 30.1, 0.3) << seed;
    EXPECT_EQ(blinded.frames, blinded.sent) << seed;
    EXPECT_TRUE(blinded.finite) << seed;
    EXPECT_LT(blinded.nees_after, 18.5) << seed;
    EXPECT_GT(blinded.used_after, 10000U) << seed;
    for (const std::uint64_t divergences : blinded.counts.divergences) EXPECT_EQ(divergences, 0U) << seed;
  }
}

} // namespace
} // namespace vi_ekf_slam::simulation

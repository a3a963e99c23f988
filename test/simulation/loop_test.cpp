// Two laps round a block: on the second one most of what the front end detects are landmarks of the first,
// with their ids.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "../sanitized.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr std::size_t kSeeds = kSanitized ? 1 : 5;

std::vector<SeedResult> driveTwoLaps(MapKeep keep, double stale_fraction) {
  DriveOptions options = studyOptions(MotionModel::kCarDrive);
  options.ids_return = true;
  options.stale_fraction = stale_fraction;
  options.strength_spread = 3.0;
  options.features_max = 75; // a closure costs their cube
  Config config;
  // The truth about its tracks: they do not slip, and their noise is white.
  config.invariant.slip.sigma = 0.0;
  config.invariant.stereo.pixel_sigma = options.pixel_sigma;
  config.invariant.map.keep = keep;
  return runSeeds(config, options, 1, kSeeds, 1);
}

/// RMS over the seeds of the position error at the end, m.
double finalError(const std::vector<SeedResult>& results) {
  double sum = 0.0;
  for (const SeedResult& result : results) sum += std::pow(result.frames.back().position, 2);
  return std::sqrt(sum / static_cast<double>(results.size()));
}

class Loop : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const double stale = DriveOptions().stale_fraction;
    none_ = driveTwoLaps(MapKeep::kNone, stale);
    good_ = driveTwoLaps(MapKeep::kGood, stale);
  }
  static std::vector<SeedResult> none_, good_;
};
std::vector<SeedResult> Loop::none_, Loop::good_;

/// Mean pose NEES from the first landmark on that is found again on the second lap.
double neesOnceClosed(const std::vector<SeedResult>& results) {
  double nees = 0.0;
  for (const SeedResult& result : results) {
    // A landmark that was behind another car for a moment is found again on the first lap already.
    const auto second_lap = result.frames.begin() + static_cast<std::ptrdiff_t>(result.frames.size() / 2);
    const auto closed = std::find_if(second_lap, result.frames.end(),
                                     [](const FrameErrors& frame) { return frame.revisited > 0; });
    if (closed == result.frames.end()) return std::numeric_limits<double>::quiet_NaN();
    double sum = 0.0;
    for (auto frame = closed; frame != result.frames.end(); ++frame) sum += frame->nees.pose;
    nees += sum / static_cast<double>(result.frames.end() - closed) / static_cast<double>(results.size());
  }
  return nees;
}

/// Not overconfident. A car accelerates less than the filter allows for, so that it may be better than it says;
/// but not so much that the covariance says nothing.
void expectHonest(double nees) {
  const auto [low, high] = chiSquareMeanBounds(6, kSeeds);
  EXPECT_GT(nees, 0.5 * low);
  EXPECT_LT(nees, high);
  std::printf("mean pose NEES %.2f (%.2f to %.2f)\n", nees, low, high);
}

TEST_F(Loop, LeavesAFifthOfTheErrorAtMost) {
  EXPECT_LT(5.0 * finalError(good_), finalError(none_));
  std::printf("final error %.3f m, without the map %.3f m\n", finalError(good_), finalError(none_));
}

TEST_F(Loop, FindsLandmarksAgain) {
  for (const SeedResult& result : good_) {
    std::size_t revisited = 0;
    for (const FrameErrors& frame : result.frames) revisited += frame.revisited;
    EXPECT_GT(revisited, 50u) << "seed " << result.seed;
  }
}

TEST_F(Loop, IsHonestOnceItIsClosed) { expectHonest(neesOnceClosed(good_)); }

// Tracks that no stale frame breaks are longer and slide farther, and more ids return.
TEST_F(Loop, IsHonestWithLongTracks) { expectHonest(neesOnceClosed(driveTwoLaps(MapKeep::kGood, 0.0))); }

} // namespace
} // namespace vi_ekf_slam::simulation

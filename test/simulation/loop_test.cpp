// Two laps round a block: on the second one most of what the front end detects are landmarks of the first,
// with their ids.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "../sanitized.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr std::size_t kSeeds = kSanitized ? 1 : 5;

std::vector<SeedResult> driveTwoLaps(MapKeep keep) {
  DriveOptions options = studyOptions(MotionModel::kCarDrive);
  options.ids_return = true;
  options.strength_spread = 3.0;
  Config config;
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
    none_ = driveTwoLaps(MapKeep::kNone);
    good_ = driveTwoLaps(MapKeep::kGood);
  }
  static std::vector<SeedResult> none_, good_;
};
std::vector<SeedResult> Loop::none_, Loop::good_;

TEST_F(Loop, LeavesAFifthOfTheErrorAtMost) {
  EXPECT_LT(5.0 * finalError(good_), finalError(none_));
  RecordProperty("final_error_none_mm", static_cast<int>(1e3 * finalError(none_)));
  RecordProperty("final_error_good_mm", static_cast<int>(1e3 * finalError(good_)));
}

TEST_F(Loop, FindsLandmarksAgain) {
  for (const SeedResult& result : good_) {
    std::size_t revisited = 0;
    for (const FrameErrors& frame : result.frames) revisited += frame.revisited;
    EXPECT_GT(revisited, 50u) << "seed " << result.seed;
  }
}

TEST_F(Loop, IsNotOverconfidentOnceItIsClosed) {
  double nees = 0.0;
  for (const SeedResult& result : good_) {
    // A landmark that was behind another car for a moment is found again on the first lap already.
    const auto second_lap = result.frames.begin() + static_cast<std::ptrdiff_t>(result.frames.size() / 2);
    const auto closed = std::find_if(second_lap, result.frames.end(),
                                     [](const FrameErrors& frame) { return frame.revisited > 0; });
    ASSERT_NE(closed, result.frames.end()) << "seed " << result.seed;
    double sum = 0.0;
    for (auto frame = closed; frame != result.frames.end(); ++frame) sum += frame->nees.pose;
    nees += sum / static_cast<double>(result.frames.end() - closed) / kSeeds;
  }
  EXPECT_LT(nees, chiSquareMeanBounds(6, kSeeds).second);
  RecordProperty("nees_hundredths", static_cast<int>(100.0 * nees));
}

} // namespace
} // namespace vi_ekf_slam::simulation

// A second drive, which begins in a frame of its own, finds its place in the map of a first one by ids that
// return.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "../sanitized.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/simulation/consistency.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"
#include "vi_ekf_slam/simulation/stale_repair.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr std::uint64_t kSeeds = kSanitized ? 1 : 4;
constexpr std::uint64_t kElsewhere = 2; // seeds further: other streets, other landmarks

/// How the second lap knows the landmarks of the first: by ids that return, or by descriptors alone.
enum class KnownBy { kIds, kLooks };

/// Two laps round a block: on the second one most of what the front end detects are landmarks of the first.
Drive twoLaps(std::uint64_t seed, KnownBy known_by) {
  const bool by_looks = known_by == KnownBy::kLooks;
  DriveOptions options = studyOptions(MotionModel::kCarDrive);
  options.seed = seed;
  options.ids_return = !by_looks;
  options.descriptors = by_looks;
  options.strength_spread = 3.0;
  // A closure costs their cube; by looks alone so few are not found on every lap.
  if (!by_looks) options.features_max = 75;
  Drive laps = simulateDrive(options);
  StaleRepair stale;
  for (DriveStep& step : laps.steps) stale.repair(step);
  return laps;
}

/// Takes the steps from `begin` to `end` of a drive through `system`.
void drive(SlamSystem& system, const Drive& laps, std::size_t begin, std::size_t end,
           const std::function<void(const DriveStep&, const Output&)>& use = {}) {
  const DriveStep* now = nullptr;
  if (use) system.onFrame([&](const Output& output) { use(*now, output); });
  for (std::size_t i = begin; i < end; ++i) {
    now = &laps.steps[i];
    for (Measurement& m : measurementsOf(*now)) system.add(std::move(m));
    system.flush(); // so that the truth is that of the frame
  }
}

/// What all tests start from; driven once for all of them.
struct FirstLap {
  Drive laps;
  std::shared_ptr<const SavedMap> map;
};

const FirstLap& firstLap(std::uint64_t seed, KnownBy known_by) {
  static std::map<std::pair<std::uint64_t, KnownBy>, FirstLap> driven;
  const auto [it, is_new] = driven.try_emplace({seed, known_by});
  FirstLap& first = it->second;
  if (is_new) {
    first.laps = twoLaps(seed, known_by);
    SlamSystem system({});
    system.setRig(first.laps.rig);
    drive(system, first.laps, 0, first.laps.steps.size() / 2);
    first.map = std::make_shared<const SavedMap>(system.estimator().savedMap()());
  }
  return first;
}

struct SecondLap {
  std::optional<std::size_t> frames_before; ///< that it was relocalised
  std::size_t relocalisations = 0;
  double nees = 0.0;       ///< mean, of the pose in the map's frame, afterwards
  double last_error = 0.0; ///< m
  MapUse use = MapUse::kNone;
};

SecondLap driveTheSecondLap(const Drive& laps, const std::shared_ptr<const SavedMap>& map) {
  SlamSystem system({});
  system.setRig(laps.rig);
  system.loadMap(map, "the first lap");
  SecondLap result;
  std::size_t frames = 0;
  drive(system, laps, laps.steps.size() / 2, laps.steps.size(),
        [&](const DriveStep& step, const Output& output) {
          if (output.report.relocalised && !result.frames_before) result.frames_before = frames;
          ++frames;
          result.last_error =
              (output.state.world_T_imu.translation() - step.world_T_imu.translation()).norm();
          if (result.frames_before) result.nees += poseNees(step.world_T_imu, output.state).pose;
        });
  if (result.frames_before) result.nees /= static_cast<double>(frames - *result.frames_before);
  result.relocalisations = system.counts().relocalisations;
  result.use = system.estimator().mapUse();
  return result;
}

TEST(Relocalisation, FindsThePlaceWithAnHonestCovariance) {
  double nees = 0.0, worst = 0.0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const auto& [laps, map] = firstLap(seed, KnownBy::kIds);
    EXPECT_NO_THROW(validate(*map, "map")) << seed;
    const SecondLap lap = driveTheSecondLap(laps, map);
    ASSERT_TRUE(lap.frames_before) << seed;
    EXPECT_LT(*lap.frames_before, 150U) << seed; // of about 600
    EXPECT_EQ(lap.relocalisations, 1U) << seed;
    EXPECT_EQ(lap.use, MapUse::kRelocalised) << seed;
    EXPECT_LT(lap.last_error, 3.0) << seed;
    std::cout << "seed " << seed << ": after " << *lap.frames_before << " frames, NEES " << lap.nees
              << ", at the end " << lap.last_error << " m, " << map->landmarks.size() << " landmarks\n";
    nees += lap.nees / kSeeds;
    worst = std::max(worst, lap.last_error);
  }
  EXPECT_LT(nees, chiSquareMeanBounds(6, kSeeds).second);
  RecordProperty("nees_hundredths", static_cast<int>(100.0 * nees));
  RecordProperty("worst_error_mm", static_cast<int>(1e3 * worst));
  std::cout << "mean NEES " << nees << " (up to " << chiSquareMeanBounds(6, kSeeds).second
            << "), worst error " << worst << " m\n";
}

/// Ids that are given out anew, as by a front end that was started again: they say nothing about the map.
Drive renumbered(Drive laps, std::size_t from) {
  std::map<FeatureId, FeatureId> ids;
  for (std::size_t i = from; i < laps.steps.size(); ++i) {
    for (StereoFeatureObservation& f : laps.steps[i].frame.features)
      f.id = ids.emplace(f.id, ids.size()).first->second;
  }
  return laps;
}

TEST(Relocalisation, FindsThePlaceByLooksAloneWithAnHonestCovariance) {
  double nees = 0.0;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const auto& [laps, map] = firstLap(seed, KnownBy::kLooks);
    const SecondLap lap = driveTheSecondLap(renumbered(laps, laps.steps.size() / 2), map);
    ASSERT_TRUE(lap.frames_before) << seed;
    EXPECT_LT(*lap.frames_before, 300U) << seed; // of about 600
    EXPECT_EQ(lap.use, MapUse::kRelocalised) << seed;
    EXPECT_LT(lap.last_error, 3.0) << seed;
    std::cout << "seed " << seed << ": after " << *lap.frames_before << " frames, NEES " << lap.nees
              << ", at the end " << lap.last_error << " m\n";
    nees += lap.nees / kSeeds;
  }
  EXPECT_LT(nees, chiSquareMeanBounds(6, kSeeds).second);
}

/// Every `every`-th feature twice, under two ids.
Drive withTwins(Drive laps, std::size_t from, FeatureId every) {
  constexpr FeatureId kTwin = FeatureId{1} << 32;
  for (std::size_t i = from; i < laps.steps.size(); ++i) {
    const auto features = laps.steps[i].frame.features;
    for (StereoFeatureObservation f : features) {
      if (f.id % every != 0) continue;
      f.id += kTwin;
      laps.steps[i].frame.features.push_back(f);
    }
  }
  return laps;
}

TEST(Relocalisation, TwoTracksOfACornerAreNotBothOneLandmark) {
  const auto& [laps, map] = firstLap(1, KnownBy::kLooks);
  const std::size_t half = laps.steps.size() / 2;
  const SecondLap lap = driveTheSecondLap(withTwins(renumbered(laps, half), half, 3), map);
  EXPECT_TRUE(lap.frames_before);
  EXPECT_LT(lap.last_error, 3.0);
}

TEST(Relocalisation, DoesNotTakeAnotherStreetForItsOwnByItsLooks) {
  for (std::uint64_t seed = 1; seed <= (kSanitized ? 1 : 2); ++seed) {
    const Drive& laps = firstLap(seed, KnownBy::kLooks).laps;
    const SecondLap lap = driveTheSecondLap(renumbered(laps, laps.steps.size() / 2),
                                            firstLap(seed + kElsewhere, KnownBy::kLooks).map);
    EXPECT_EQ(lap.relocalisations, 0U) << seed;
  }
}

TEST(Relocalisation, DoesNotTakeAnotherDriveForItsOwn) {
  for (std::uint64_t seed = 1; seed <= (kSanitized ? 1 : 2); ++seed) {
    // The same ids, of other points.
    const SecondLap lap =
        driveTheSecondLap(firstLap(seed, KnownBy::kIds).laps, firstLap(seed + kElsewhere, KnownBy::kIds).map);
    EXPECT_FALSE(lap.frames_before) << seed;
    EXPECT_EQ(lap.relocalisations, 0U) << seed;
    EXPECT_EQ(lap.use, MapUse::kWaiting) << seed;
  }
}

TEST(Relocalisation, IsDoneAgainAfterAReset) {
  const auto& [laps, map] = firstLap(1, KnownBy::kIds);
  SlamSystem system({});
  system.setRig(laps.rig);
  system.loadMap(map, "the first lap");
  const std::size_t half = laps.steps.size() / 2;
  drive(system, laps, half, half + 200);
  EXPECT_EQ(system.counts().relocalisations, 1U);
  EXPECT_EQ(system.counts().resets, 0U);
  system.reset("a test");
  EXPECT_EQ(system.estimator().mapUse(), MapUse::kWaiting);
  drive(system, laps, half + 200, half + 400);
  EXPECT_EQ(system.counts().relocalisations, 2U);
}

} // namespace
} // namespace vi_ekf_slam::simulation

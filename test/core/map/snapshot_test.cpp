// What goes out as a saved map comes back as it was.

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

#include "../road.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

/// In units of the standard deviations.
double worstCorrelationError(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected) {
  const Eigen::VectorXd scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  return (scale.asDiagonal() * (actual - expected) * scale.asDiagonal()).cwiseAbs().maxCoeff();
}

std::shared_ptr<const SavedMap> savedOf(const Estimator& estimator) {
  return std::make_shared<const SavedMap>(estimator.savedMap()());
}

/// An estimator that has resumed from `map` a moment (s) after it was saved.
InvariantEstimator resumedFrom(const std::shared_ptr<const SavedMap>& map, double gap) {
  InvariantEstimator estimator = withRig();
  estimator.resumeFrom(map, "map", 30.0);
  estimator.process(StereoFrame{map->stamp + fromSeconds(gap), {}});
  return estimator;
}

InvariantConfig keepAll() {
  InvariantConfig config = steadyTracks();
  config.map.keep = MapKeep::kAll;
  return config;
}

TEST(Snapshot, HoldsTheEstimateAndIsValid) {
  Road road(1, 40, kTypical);
  const InvariantEstimator estimator = driven(road, 60);
  const auto map = savedOf(estimator);
  EXPECT_NO_THROW(validate(*map, "snapshot"));
  const StateEstimate state = estimator.state();
  EXPECT_EQ(map->stamp, state.stamp);
  EXPECT_LT(distance(map->world_T_imu.matrix(), state.world_T_imu.matrix()), 1e-12);
  EXPECT_LT(worstCorrelationError(map->covariance.topLeftCorner<6, 6>(), state.pose_covariance), 1e-9);
  EXPECT_LT(worstCorrelationError(map->covariance.block<6, 6>(6, 6), state.twist_covariance), 1e-9);
  std::size_t compared = 0;
  for (const LandmarkEstimate& l : estimator.exactMap()().landmarks) {
    for (std::size_t i = 0; i < map->landmarks.size(); ++i) {
      if (map->landmarks[i].id != l.id) continue;
      const Eigen::Index row = map->rowOf(i);
      EXPECT_LT(distance(map->landmarks[i].position, l.position), 1e-9);
      EXPECT_LT(worstCorrelationError(map->covariance.block<3, 3>(row, row), l.covariance), 1e-9);
      ++compared;
    }
  }
  EXPECT_EQ(compared, map->landmarks.size());
  EXPECT_GT(compared, 40U) << "some are out of view";
}

TEST(Snapshot, IsOfWhenItWasMade) {
  Road road(2, 40, kTypical);
  InvariantEstimator estimator = driven(road, 40);
  const auto snapshot = estimator.savedMap();
  const auto then = savedOf(estimator);
  for (int i = 0; i < 40; ++i) road.feed(estimator);
  const SavedMap later = snapshot();
  EXPECT_EQ(later.stamp, then->stamp);
  EXPECT_EQ(later.landmarks.size(), then->landmarks.size());
  EXPECT_EQ(later.covariance, then->covariance);
  EXPECT_NE(savedOf(estimator)->stamp, then->stamp);
}

TEST(Snapshot, OfTheLandmarksIsOfWhenItWasMade) {
  Road road(8, 40, kTypical);
  InvariantConfig config = steadyTracks();
  config.map.max_landmarks = 30; // so that some are archived
  InvariantEstimator estimator = driven(road, 60, config);
  const auto snapshot = estimator.exactMap();
  const std::vector<LandmarkEstimate> then = estimator.exactMap()().landmarks;
  for (int i = 0; i < 40; ++i) road.feed(estimator);
  const std::vector<LandmarkEstimate> later = snapshot().landmarks;
  ASSERT_EQ(later.size(), then.size());
  for (std::size_t i = 0; i < then.size(); ++i) {
    EXPECT_EQ(later[i].id, then[i].id);
    EXPECT_EQ(later[i].position, then[i].position);
    EXPECT_EQ(later[i].covariance, then[i].covariance);
  }
  EXPECT_NE(estimator.exactMap()().landmarks.back().id, then.back().id) << "the drive went on";
}

TEST(Snapshot, OfTheLandmarksIsExact) {
  Road road(9, 40, kTypical);
  const InvariantEstimator estimator = driven(road, 60);
  const std::vector<LandmarkEstimate> exact = estimator.exactMap()().landmarks,
                                      last_settled = estimator.landmarks();
  ASSERT_EQ(exact.size(), last_settled.size());
  double gained = 0.0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    EXPECT_EQ(exact[i].id, last_settled[i].id);
    gained += last_settled[i].covariance.trace() - exact[i].covariance.trace();
  }
  EXPECT_GT(gained, 0.0);
}

TEST(Snapshot, ThereIsNoneWithoutAJointMapOrAMeasurement) {
  InvariantConfig config = steadyTracks();
  EXPECT_FALSE(withRig(config).savedMap());
  EXPECT_TRUE(withRig(config).keepsJointMap());
  config.map.keep = MapKeep::kNone;
  Road road(3, 20, kTypical);
  const InvariantEstimator without = driven(road, 5, config);
  EXPECT_FALSE(without.keepsJointMap());
  EXPECT_FALSE(without.savedMap());
}

TEST(Resume, RestoresTheWholeJointCovariance) {
  Road road(4, 40, kTypical);
  const InvariantEstimator estimator = driven(road, 60, keepAll());
  const auto map = savedOf(estimator);
  const InvariantEstimator resumed = resumedFrom(map, 0.0);
  EXPECT_EQ(resumed.mapUse(), MapUse::kResumed);
  const auto again = savedOf(resumed);
  EXPECT_EQ(again->stamp, map->stamp);
  EXPECT_LT(distance(again->world_T_imu.matrix(), map->world_T_imu.matrix()), 1e-12);
  ASSERT_EQ(again->variables.size(), map->variables.size());
  for (std::size_t i = 0; i < map->variables.size(); ++i) {
    EXPECT_EQ(again->variables[i].name, map->variables[i].name);
    EXPECT_EQ(again->variables[i].mean, map->variables[i].mean);
  }
  ASSERT_EQ(again->landmarks.size(), map->landmarks.size());
  for (std::size_t i = 0; i < map->landmarks.size(); ++i) {
    EXPECT_EQ(again->landmarks[i].id, map->landmarks[i].id);
    EXPECT_EQ(again->landmarks[i].observations, map->landmarks[i].observations);
    EXPECT_EQ(again->landmarks[i].position, map->landmarks[i].position);
  }
  // What is added to the variances allows for rounding: 1e-12 of the largest.
  const double largest =
      map->covariance.diagonal().maxCoeff() +
      1e4 * map->covariance.diagonal().segment<3>(3).maxCoeff(); // no landmark is 100 m away
  Eigen::MatrixXd more = again->covariance - map->covariance;
  EXPECT_GE(more.diagonal().minCoeff(), -1e-15 * largest);
  EXPECT_LT(more.diagonal().maxCoeff(), 2e-12 * largest);
  more.diagonal().setZero();
  EXPECT_LT(worstCorrelationError(map->covariance + more, map->covariance), 1e-9);
}

TEST(Resume, IsAsUnsureAfterAGapAsTheMotionMakesIt) {
  Road road(5, 40, kTypical);
  const auto map = savedOf(driven(road, 60));
  const Matrix6d at_once = resumedFrom(map, 0.0).state().pose_covariance;
  const Matrix6d later = resumedFrom(map, 5.0).state().pose_covariance;
  const InvariantConfig config = steadyTracks();
  // White noise of the derivative: density^2 t^3 / 3, beside what the twist's own error comes to.
  EXPECT_GT(later(5, 5), at_once(5, 5) + std::pow(config.motion.twist_density[5], 2) * 125.0 / 3.0);
  const double position = later.topLeftCorner<3, 3>().trace();
  EXPECT_GT(position, std::pow(config.motion.twist_density[0], 2) * 125.0 / 3.0);
}

// What should come into view, and does not, stays inactive and slides with no track.
TEST(Resume, LeavesWhatIsNotSeenAgainAsItWas) {
  Road road(6, 60, kTypical);
  const auto map = savedOf(driven(road, 60));
  InvariantEstimator resumed = withRig();
  resumed.resumeFrom(map, "map", 30.0);
  std::set<FeatureId> seen;
  std::size_t revisited = 0;
  for (int i = 0; i < 120; ++i) {
    for (const StereoFeatureObservation& feature : road.frame().features) seen.insert(feature.id);
    const FrameReport report = road.feed(resumed);
    revisited += report.revisited;
    EXPECT_LE(report.landmarks, report.features) << i;
  }
  EXPECT_GT(revisited, 5u);
  std::set<FeatureId> saved;
  const auto later = savedOf(resumed);
  for (const SavedLandmark& l : later->landmarks) saved.insert(l.id);
  std::size_t compared = 0;
  for (const LandmarkEstimate& l : resumed.exactMap()().landmarks) {
    for (std::size_t i = 0; i < map->landmarks.size(); ++i) {
      if (map->landmarks[i].id != l.id || seen.count(l.id)) continue;
      const Eigen::Index row = map->rowOf(i);
      const Eigen::Matrix3d before = map->covariance.block<3, 3>(row, row);
      EXPECT_TRUE(isPositive(before - l.covariance + 1e-2 * before.norm() * Eigen::Matrix3d::Identity()))
          << l.id;
      EXPECT_TRUE(saved.count(l.id)) << l.id << " is not in the joint map any more";
      ++compared;
    }
  }
  EXPECT_GT(compared, 5U);
}

TEST(Resume, GoesOnAsIfNothingHadHappened) {
  Road road(6, 60, kTypical);
  InvariantEstimator estimator = driven(road, 60);
  const auto map = savedOf(estimator);
  InvariantEstimator resumed = withRig();
  resumed.resumeFrom(map, "map", 30.0);
  std::size_t revisited = 0;
  for (int i = 0; i < 20; ++i) {
    Road same = road;
    same.feed(estimator);
    revisited += road.feed(resumed).revisited;
  }
  EXPECT_GE(revisited, 20U) << "what was in view when it was saved is fused";
  const StateEstimate a = estimator.state(), b = resumed.state();
  EXPECT_LT((a.world_T_imu.translation() - b.world_T_imu.translation()).norm(), 0.1);
  EXPECT_LT(positionError(resumed, road.truth()), positionError(estimator, road.truth()) + 0.1);
  EXPECT_LT(b.pose_covariance(5, 5), 2.0 * a.pose_covariance(5, 5));
  EXPECT_LT(b.pose_covariance(0, 0), 2.0 * a.pose_covariance(0, 0));
}

// Three frames tell in which direction points of up to 1 km are, and of how far away little, wrong to the
// same side.
TEST(Resume, ComparesWhatReturnsOnceItsDistanceIsKnown) {
  const auto revisited = [](double farthest, int frames) {
    Road road(6, 60, kTypical, farthest);
    const auto map = savedOf(driven(road, 60));
    InvariantEstimator resumed = withRig();
    resumed.resumeFrom(map, "map", 30.0);
    std::size_t count = 0;
    for (int i = 0; i < frames; ++i) count += road.feed(resumed).revisited;
    return count;
  };
  EXPECT_GE(revisited(15.0, 3), 15U);
  EXPECT_EQ(revisited(1000.0, 3), 0U);
  EXPECT_GT(revisited(1000.0, 12), 0U);
}

TEST(Resume, IsARelocalisationWhereTheSavedMapIsTooOld) {
  Road road(7, 40, kTypical);
  const auto map = savedOf(driven(road, 60));
  for (const double gap : {31.0, 20.0, -0.1}) { // after 20 s it may be turned any way
    const InvariantEstimator late = resumedFrom(map, gap);
    EXPECT_EQ(late.mapUse(), MapUse::kWaiting);
    EXPECT_LT(distance(late.state().world_T_imu.matrix(), SE3().matrix()), 1e-12);
  }
}

/// Ids of a drive's landmarks by how often and for how long they were tracked.
struct Track {
  std::size_t count = 0;
  Stamp first = 0, last = 0;
};

TEST(Snapshot, HoldsWhatWasTrackedForLongEnoughAtAnyRateOfTheFrames) {
  for (const double rate : {5.0, 10.0, 30.0}) {
    Road road(10, 40, kQuiet);
    road.setRates(rate, static_cast<int>(std::lround(30.0 / rate)));
    InvariantEstimator estimator = withRig();
    std::map<FeatureId, Track> tracks;
    std::set<FeatureId> in_view;
    for (int i = 0; i < static_cast<int>(15.0 * rate); ++i) {
      const FrameReport report = road.feed(estimator, [&](StereoFrame& frame) {
        in_view.clear();
        for (const auto& f : frame.features) {
          Track& track = tracks[f.id];
          if (track.count++ == 0) track.first = frame.stamp;
          track.last = frame.stamp;
          in_view.insert(f.id);
        }
      });
      ASSERT_EQ(report.rejected, 0u);
    }
    std::set<FeatureId> saved;
    const auto map = savedOf(estimator);
    for (const SavedLandmark& l : map->landmarks) saved.insert(l.id);
    int wrong = 0, kept = 0;
    for (const auto& [id, track] : tracks) {
      const bool good = track.count >= 3 && secondsBetween(track.first, track.last) >= 0.9;
      kept += good ? 1 : 0;
      if (!in_view.count(id)) wrong += (saved.count(id) == 1) != good ? 1 : 0;
    }
    EXPECT_EQ(wrong, 0) << rate;
    EXPECT_GT(kept, 30) << rate;
  }
}

// What the map knows it goes on to know.
TEST(Resume, KeepsALandmarkOfTheMapHoweverShortlyItIsSeenAgain) {
  for (const int frames : {4, 6, 8}) {
    Road road(6, 60, kTypical, 15.0);
    const auto map = savedOf(driven(road, 60));
    std::set<FeatureId> known, again;
    for (const SavedLandmark& l : map->landmarks) known.insert(l.id);
    InvariantEstimator resumed = withRig();
    resumed.resumeFrom(map, "map", 30.0);
    std::size_t revisited = 0;
    for (int i = 0; i < frames; ++i) {
      revisited += road.feed(resumed,
                             [&](StereoFrame& frame) {
                               for (const auto& f : frame.features) again.insert(f.id);
                             })
                       .revisited;
    }
    ASSERT_GE(revisited, 5u) << frames;
    for (int i = 0; i < 15; ++i) road.move(); // all tracks are lost
    road.feed(resumed);
    std::set<FeatureId> left;
    const auto later = savedOf(resumed);
    for (const SavedLandmark& l : later->landmarks) left.insert(l.id);
    std::size_t missing = 0;
    for (const FeatureId id : known) missing += again.count(id) && !left.count(id) ? 1 : 0;
    EXPECT_EQ(missing, 0u) << "of those that were seen again, after " << frames << " frames";
  }
}

} // namespace
} // namespace vi_ekf_slam

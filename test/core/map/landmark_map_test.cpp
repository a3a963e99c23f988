#include "vi_ekf_slam/core/map/landmark_map.hpp"

#include <algorithm>

#include "../filter/states.hpp"
#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"
#include "vi_ekf_slam/core/map/snapshot.hpp"

namespace vi_ekf_slam::test {
namespace {

/// Landmarks of ids 100, 101, ... that were seen for `seconds`.
struct Mapped {
  Mapped(unsigned seed, std::size_t count, const LandmarkMap::Options& options, double seconds = 2.0,
         std::size_t observations = 10)
      : random(seed), scene(busyScene(random, count)), map(options) {
    for (std::size_t i = 0; i < count; ++i)
      map.add(
          {100 + i, scene.points[i], observations, fromSeconds(10.0), fromSeconds(10.0 + seconds), false});
  }
  std::size_t indexOf(FeatureId id) const { return map.indexById().at(id); }
  void leave(FeatureId id) { map.leave(scene.filter, indexOf(id)); }

  Random random;
  Scene scene;
  LandmarkMap map;
};

LandmarkMap::Options keeping(MapKeep keep, std::size_t most = 2000) {
  LandmarkMap::Options options;
  options.keep = keep;
  options.max_landmarks = most;
  return options;
}

const LandmarkEstimate* find(const std::vector<LandmarkEstimate>& all, FeatureId id) {
  const auto found = std::find_if(all.begin(), all.end(), [id](const auto& l) { return l.id == id; });
  return found == all.end() ? nullptr : &*found;
}

TEST(LandmarkMapTest, KeepsWhatWasTrackedForLongEnoughInTheJointCovariance) {
  struct Case {
    MapKeep keep;
    double seconds;
    std::size_t observations;
    bool inactive, archived;
  };
  for (const Case& c :
       {Case{MapKeep::kGood, 2.0, 10, true, false}, Case{MapKeep::kGood, 0.5, 10, false, true},
        Case{MapKeep::kGood, 2.0, 2, false, false}, Case{MapKeep::kAll, 0.0, 1, true, false},
        Case{MapKeep::kNone, 9.0, 99, false, true}}) {
    Mapped mapped(1, 3, keeping(c.keep), c.seconds, c.observations);
    const Eigen::Vector3d position = mapped.scene.filter.variables().point(mapped.scene.points[1]);
    const Eigen::Matrix3d covariance = mapped.scene.filter.worldCovariance(mapped.scene.points[1]);
    mapped.leave(101);
    EXPECT_EQ(mapped.map.isInactive(101), c.inactive);
    EXPECT_EQ(mapped.scene.filter.inactive().size(), c.inactive ? 1u : 0u);
    EXPECT_EQ(mapped.map.archive().landmarks().count(101), c.archived ? 1u : 0u);
    ASSERT_EQ(mapped.map.active().size(), 2u);
    EXPECT_EQ(mapped.map.active()[1].id, 102u) << "the last one took its place";
    const auto all = mapped.map.estimates(mapped.scene.filter, true);
    EXPECT_EQ(all.size(), c.inactive || c.archived ? 3u : 2u);
    if (const LandmarkEstimate* left = find(all, 101)) {
      EXPECT_LT(distance(left->position, position), 1e-12);
      EXPECT_LT(distance(left->covariance, covariance), 1e-12);
    }
  }
}

TEST(LandmarkMapTest, ForgetsWhatIsDiscardedAndWhatTheMapHasAlready) {
  Mapped mapped(2, 4, keeping(MapKeep::kGood));
  mapped.map.discard(mapped.scene.filter, mapped.indexOf(103));
  EXPECT_EQ(find(mapped.map.estimates(mapped.scene.filter, true), 103), nullptr);
  mapped.leave(100);
  const Eigen::Vector3d before = find(mapped.map.estimates(mapped.scene.filter, true), 100)->position;
  // It comes back as a new one and leaves again: the map's stays.
  mapped.scene.addPoint(mapped.random);
  mapped.map.add({100, mapped.scene.points.back(), 10, 0, fromSeconds(5.0), false});
  EXPECT_EQ(find(mapped.map.estimates(mapped.scene.filter, true), 100)->position, before);
  mapped.leave(100);
  EXPECT_EQ(mapped.scene.filter.inactive().size(), 1u);
  EXPECT_EQ(find(mapped.map.estimates(mapped.scene.filter, true), 100)->position, before);
}

TEST(LandmarkMapTest, ReactivatesInTheOrderThatIsAskedFor) {
  Mapped mapped(3, 5, keeping(MapKeep::kGood));
  const auto before = mapped.map.estimates(mapped.scene.filter, true);
  for (const FeatureId id : {100, 101, 102}) mapped.leave(id);
  mapped.map.reactivate(mapped.scene.filter, {102, 100});
  ASSERT_EQ(mapped.map.active().size(), 4u);
  EXPECT_EQ(mapped.map.active()[2].id, 102u);
  EXPECT_EQ(mapped.map.active()[3].id, 100u);
  EXPECT_TRUE(mapped.map.active()[3].reactivated);
  EXPECT_EQ(mapped.map.active()[3].last_seen, fromSeconds(12.0)) << "not by that";
  EXPECT_EQ(mapped.map.active()[3].observations, 10u);
  EXPECT_TRUE(mapped.map.isInactive(101));
  EXPECT_FALSE(mapped.map.isInactive(100));
  const auto after = mapped.map.estimates(mapped.scene.filter, true);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < after.size(); ++i) {
    EXPECT_EQ(after[i].id, before[i].id);
    EXPECT_LT(distance(after[i].position, before[i].position), 1e-12);
    EXPECT_LT(distance(after[i].covariance, before[i].covariance), 1e-11);
  }
}

TEST(LandmarkMapTest, ExpectsWhatIsInactiveForTenSeconds) {
  Mapped mapped(6, 5, keeping(MapKeep::kGood));
  for (const FeatureId id : {100, 101, 102}) mapped.leave(id);
  mapped.map.expect({101, 103, 100}, fromSeconds(50.0));
  using Ids = std::vector<FeatureId>;
  EXPECT_EQ(mapped.map.expected(fromSeconds(60.0)), (Ids{101, 100})) << "103 is active";
  EXPECT_EQ(mapped.map.expected(fromSeconds(60.1)), Ids());
  mapped.map.clear();
  EXPECT_EQ(mapped.map.expected(fromSeconds(50.0)), Ids());
}

TEST(LandmarkMapTest, MakesActiveWhatIsExpectedAndComesIntoView) {
  Mapped mapped(7, 5, keeping(MapKeep::kGood));
  for (const FeatureId id : {100, 101, 102}) mapped.leave(id);
  mapped.map.expect({101, 100}, fromSeconds(50.0));
  StereoFrame frame{fromSeconds(50.1), {}, 0.0};
  for (const FeatureId id : {100, 101, 102, 103}) frame.features.push_back({id, StereoPixels::Zero()});
  ReturningLandmarks::recognise(mapped.scene.filter, mapped.map, frame, {0, 2, 3}); // 101 is of no use
  EXPECT_FALSE(mapped.map.isInactive(100));
  EXPECT_TRUE(mapped.map.isInactive(101));
  EXPECT_TRUE(mapped.map.isInactive(102)) << "is in view, but not expected";
  EXPECT_EQ(mapped.map.active().back().id, 100u);
  EXPECT_TRUE(mapped.map.active().back().reactivated);
  EXPECT_EQ(mapped.map.active().back().last_seen, fromSeconds(12.0)) << "not by that";
}

TEST(LandmarkMapTest, IsBoundedByItsOldest) {
  Mapped mapped(4, 12, keeping(MapKeep::kGood, 4));
  for (FeatureId id = 100; id < 109; ++id) mapped.leave(id);
  const auto before = mapped.map.estimates(mapped.scene.filter, true);
  mapped.scene.filter.settleInactive(); // else a block of them may go at once
  mapped.map.bound(mapped.scene.filter);
  EXPECT_LE(mapped.scene.filter.inactive().size(), 4u);
  EXPECT_TRUE(mapped.map.isInactive(108));
  EXPECT_FALSE(mapped.map.isInactive(100));
  const auto after = mapped.map.estimates(mapped.scene.filter, true);
  ASSERT_EQ(after.size(), before.size()) << "their last estimates stay";
  for (std::size_t i = 0; i < after.size(); ++i) {
    EXPECT_LT(distance(after[i].position, before[i].position), 1e-9);
    Eigen::MatrixXd more = after[i].covariance - before[i].covariance;
    more.diagonal().array() += 1e-9;
    EXPECT_EQ(Eigen::LLT<Eigen::MatrixXd>(more).info(), Eigen::Success) << "and are never surer";
  }
  mapped.map.bound(mapped.scene.filter, true);
  EXPECT_TRUE(mapped.scene.filter.inactive().isEmpty());
}

TEST(LandmarkMapTest, IsBoundedOnceNoThreadSettlesIt) {
  Mapped mapped(4, 16, keeping(MapKeep::kGood, 4));
  for (FeatureId id = 100; id < 113; ++id) mapped.leave(id); // a block has ended
  mapped.scene.filter.beginSettlingInactive();
  mapped.map.bound(mapped.scene.filter);
  EXPECT_EQ(mapped.scene.filter.inactive().size(), 13u) << "it would have to wait";
  EXPECT_TRUE(mapped.scene.filter.inactive().isSettling());
  mapped.scene.filter.endSettlingInactive();
  mapped.map.bound(mapped.scene.filter);
  EXPECT_LE(mapped.scene.filter.inactive().size(), 4u);
}

TEST(LandmarkMapTest, ArchivesAllThatIsValidBeforeAFilterIsGivenUp) {
  Mapped mapped(5, 5, keeping(MapKeep::kGood));
  mapped.leave(100);
  mapped.map.archiveAll(mapped.scene.filter);
  EXPECT_TRUE(mapped.map.active().empty());
  EXPECT_FALSE(mapped.map.isInactive(100));
  EXPECT_EQ(mapped.map.archive().landmarks().size(), 5u);
}

TEST(LandmarkMapTest, IsSavedAndRestoredWithItsJointCovariance) {
  Mapped mapped(6, 8, keeping(MapKeep::kGood));
  for (const FeatureId id : {100, 103, 105}) mapped.leave(id);
  Filter& filter = mapped.scene.filter;
  mapped.scene.motion.propagate(filter, 0.1);
  const SavedMap saved = snapshotOf(filter, mapped.map, fromSeconds(20.0));
  validate(saved, "test");
  ASSERT_EQ(saved.landmarks.size(), 8u);
  EXPECT_EQ(saved.landmarks[0].id, 100u) << "longest out of view";

  ConstantTwist motion(noisyMotion());
  Filter fresh(SE3(), Matrix6d::Identity());
  motion.addTo(fresh);
  fresh.closeCore();
  LandmarkMap map(keeping(MapKeep::kGood));
  restore(saved, fresh, map);
  EXPECT_LT(distance(fresh.pose().matrix(), filter.pose().matrix()), 1e-12);
  EXPECT_LT(distance(motion.twist(fresh, kNoImu, 0), mapped.scene.motion.twist(filter, kNoImu, 0)), 1e-12);
  filter.settle();
  const auto before = mapped.map.estimates(filter, true), after = map.estimates(fresh, true);
  ASSERT_EQ(after.size(), before.size());
  for (std::size_t i = 0; i < after.size(); ++i) {
    EXPECT_EQ(after[i].id, before[i].id);
    EXPECT_LT(distance(after[i].position, before[i].position), 1e-9);
    EXPECT_LT(worstCorrelationError(after[i].covariance, before[i].covariance), 1e-6);
  }
  const SavedMap again = snapshotOf(fresh, map, fromSeconds(20.0));
  EXPECT_LT(worstCorrelationError(again.covariance, saved.covariance), 1e-6);
}

// Far points, which corrections of their inverse depth have sent farther: one of them made the whole map one
// that is refused.
TEST(LandmarkMapTest, IsSavedWithoutLandmarksThatNobodyKnowsThePlaceOf) {
  Mapped mapped(7, 6, keeping(MapKeep::kGood));
  for (const FeatureId id : {102, 103}) mapped.leave(id);
  const SavedMap before = snapshotOf(mapped.scene.filter, mapped.map, fromSeconds(20.0));
  Filter& filter = mapped.scene.filter;
  const auto vague = [&](FeatureId id, const Eigen::Vector3d& position, double variance) {
    const Handle point = filter.augment(Chart::kPoint, position, variance * Eigen::Matrix3d::Identity());
    mapped.map.add({id, point, 10, fromSeconds(10.0), fromSeconds(12.0), false});
  };
  vague(201, Eigen::Vector3d(1e5, 0.0, 0.0), 3.9e12);
  mapped.leave(201);
  vague(202, Eigen::Vector3d(40.0, 0.0, 0.0), 2e6);
  vague(203, Eigen::Vector3d(0.0, 2e6, 0.0), 1.0);
  const SavedMap saved = snapshotOf(filter, mapped.map, fromSeconds(20.0));
  EXPECT_NO_THROW(validate(saved, "test"));
  ASSERT_EQ(saved.landmarks.size(), before.landmarks.size());
  for (std::size_t i = 0; i < before.landmarks.size(); ++i)
    EXPECT_EQ(saved.landmarks[i].id, before.landmarks[i].id);
  EXPECT_LT(worstCorrelationError(saved.covariance, before.covariance), 1e-9)
      << "the others are as they were";
}

} // namespace
} // namespace vi_ekf_slam::test

#include "vi_ekf_slam/core/invariant/inactive_map.hpp"

#include <Eigen/Cholesky>
#include <set>

#include "../../sanitized.hpp"
#include "dense_drive.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InactiveMap, EqualsTheDenseJointFilterWithReobservations) {
  for (unsigned seed = 1; seed <= (kSanitized ? 1u : 3u); ++seed) {
    Twins twins(seed);
    for (int frame = 1; frame <= 60; ++frame) {
      twins.step();
      if (frame % 7 == 0) twins.activateSome(3);
      if (frame % 20 == 0) twins.expectEqual();
    }
    EXPECT_GT(twins.activated(), 15u);
    EXPECT_GT(twins.dense().inactive.size(), 30u);
  }
}

TEST(InactiveMap, EqualsTheDenseJointFilterAfterALongDeferral) {
  Twins twins(4);
  for (int frame = 0; frame < 80; ++frame) twins.step();
  EXPECT_GT(twins.dense().inactive.size(), 80u);
  twins.activateSome(10);
  for (int frame = 0; frame < 3; ++frame) twins.step();
  twins.expectEqual();
}

TEST(InactiveMap, EqualsTheDenseJointFilterWhereTheJournalIsComposedAgainAndAgain) {
  Twins twins(10, 1);
  for (int frame = 1; frame <= 120; ++frame) {
    twins.step();
    if (frame % 15 == 0) twins.marginaliseOldest(11);
    if (frame == 70) twins.activateSome(3);
    if (frame % 30 != 0) continue;
    twins.expectEstimates(InactiveMap::Covariances::kExact);
    twins.expectEstimates(InactiveMap::Covariances::kLastSettled);
    twins.expectEqual();
  }
}

TEST(InactiveMap, EqualsTheDenseJointFilterWhileTheJournalIsBeingComposed) {
  for (const std::size_t kilobytes : {100, 400}) {
    Twins twins(12, kilobytes << 10);
    for (int frame = 1; frame <= 120; ++frame) {
      twins.step();
      if (frame % 15 == 0) twins.marginaliseOldest(11);
      if (frame == 70) twins.activateSome(3);
      if (frame % 3 == 0) twins.compose(1e5);
      if (frame % 20 != 0) continue;
      twins.expectEstimates(InactiveMap::Covariances::kExact);
      twins.expectEstimates(InactiveMap::Covariances::kLastSettled);
      twins.expectEqual();
    }
  }
}

// The journal's chunks end where a landmark comes, and after 256 steps where none does, which may be at a
// departure.
TEST(InactiveMap, EqualsTheDenseJointFilterWhereNothingIsBornForLong) {
  for (int before = 90; before <= 130; before += 2) {
    Twins twins(14, std::size_t{8} << 10);
    for (int frame = 0; frame < 5; ++frame) twins.step();
    for (int frame = 0; frame < before; ++frame) twins.coast();
    twins.deactivateSome(5);
    for (int frame = 0; frame < 200; ++frame) twins.coast();
    while (twins.compose(1e5) > 0.0) twins.coast();
    twins.expectEstimates(InactiveMap::Covariances::kExact);
    twins.expectEqual();
    twins.step();
    twins.activateSome(3);
    twins.expectEqual();
  }
}

TEST(InactiveMap, IsComposedAFewStepsAtATime) {
  Twins twins(13);
  for (int frame = 1; frame <= 60; ++frame) twins.step();
  const double before = twins.state().inactive().settlingCost(twins.state().size());
  constexpr double kBudget = 1e5, kLargestStep = 5.0 * 48.0 * 48.0 * 30.0;
  std::size_t calls = 0;
  double composed = 0.0;
  while (const double cost = twins.compose(kBudget)) {
    EXPECT_LE(cost, kBudget + kLargestStep);
    composed += cost;
    ++calls;
  }
  EXPECT_GT(calls, 50u);
  EXPECT_GT(composed, 0.3 * before);
  EXPECT_LT(twins.state().inactive().settlingCost(twins.state().size()), before);
  twins.expectEstimates(InactiveMap::Covariances::kExact);
  twins.expectEqual();
}

TEST(InactiveMap, HasLessToSettleAndToHoldOnceTheJournalIsComposed) {
  Twins composed(11, 1), deferred(11);
  for (int frame = 1; frame <= 60; ++frame) {
    composed.step();
    deferred.step();
  }
  const InactiveMap &one = composed.state().inactive(), &other = deferred.state().inactive();
  EXPECT_LT(one.settlingCost(composed.state().size()), other.settlingCost(deferred.state().size()));
  EXPECT_LT(one.bytes(), other.bytes());
}

TEST(InactiveMap, StaysExactForTheRestWhenTheOldestAreMarginalised) {
  Twins twins(5);
  for (int frame = 1; frame <= 80; ++frame) {
    twins.step();
    if (frame > 20 && frame % 10 == 0) twins.marginaliseOldest(9);
    if (frame % 25 == 0) twins.activateSome(3);
    if (frame % 20 == 0) twins.expectEqual();
  }
}

TEST(InactiveMap, EstimatesAreThoseOfTheDenseJointFilter) {
  Twins twins(6);
  for (int frame = 1; frame <= 60; ++frame) {
    twins.step();
    if (frame == 30) twins.activateSome(3);
    if (frame % 20 == 0) {
      twins.expectEstimates(InactiveMap::Covariances::kExact);
      twins.expectEstimates(InactiveMap::Covariances::kLastSettled);
    }
  }
}

TEST(InactiveMap, MarginalisesThoseThatAreLongestOutOfView) {
  Random random(7);
  State state(kPrior, true);
  for (FeatureId id = 1; id <= 6; ++id)
    state.addLandmark(id, random.vector<3>(-5.0, 5.0), random.covariance<3>());
  const auto deactivate = [&](FeatureId id) {
    for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
      if (state.landmarks()[i].id == id) return state.deactivateLandmark(i);
    }
    FAIL() << id << " is not active";
  };
  for (const FeatureId id : {4, 2, 5}) deactivate(id);
  state.activateLandmarks({4});
  for (const FeatureId id : {1, 4}) deactivate(id);
  std::vector<FeatureId> gone;
  for (const InactiveLandmark& landmark : state.marginaliseOldest(3)) gone.push_back(landmark.landmark.id);
  EXPECT_EQ(gone, (std::vector<FeatureId>{2, 5, 1}));
  EXPECT_TRUE(state.inactive().contains(4));
  EXPECT_EQ(state.inactive().size(), 1u);
}

TEST(InactiveMap, HoldsNothingOfADriveWhoseLandmarksAllWentAway) {
  Random random(8);
  State state(kPrior, true);
  for (int frame = 0; frame < 1000; ++frame) {
    state.propagate(0.1, kNoise);
    state.addLandmark(static_cast<FeatureId>(frame), random.vector<3>(-5.0, 5.0), random.covariance<3>());
    state.deactivateLandmark(0);
    if (state.inactive().size() > 50) state.marginaliseOldest(1);
  }
  const std::size_t bytes = state.inactive().bytes();
  for (int frame = 1000; frame < 2000; ++frame) {
    state.propagate(0.1, kNoise);
    state.addLandmark(static_cast<FeatureId>(frame), random.vector<3>(-5.0, 5.0), random.covariance<3>());
    state.deactivateLandmark(0);
    state.marginaliseOldest(1);
  }
  EXPECT_LE(state.inactive().bytes(), bytes + bytes / 5);
}

TEST(InactiveMap, NeedsTheMeasurementMatrixAndKnownIds) {
  Random random(9);
  State state(kPrior, true);
  state.addLandmark(3, {1.0, 2.0, 3.0}, random.covariance<3>());
  const Update update = updateOf(state, twistRows(state, 0), Eigen::Matrix3d::Identity());
  EXPECT_THROW(state.apply(Correction(update.PHt, update.S, Eigen::Vector3d::Zero())), std::logic_error);
  EXPECT_THROW(state.activateLandmarks({3}), std::out_of_range);
  state.deactivateLandmark(0);
  state.addLandmark(3, {1.0, 2.0, 3.0}, random.covariance<3>());
  EXPECT_THROW(state.deactivateLandmark(0), std::logic_error);
}

} // namespace
} // namespace vi_ekf_slam::invariant

// Variables that take part in nothing: exactly what they would be if they did, and what it costs.

#include "vi_ekf_slam/core/filter/inactive_store.hpp"

#include <algorithm>
#include <stdexcept>

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// A drive whose points leave one after the other.
struct Leaving {
  explicit Leaving(unsigned seed) : random(seed), scene(busyScene(random, 8, 0.02)) {}

  void frame() {
    for (int sample = 0; sample < 2; ++sample) {
      scene.motion.propagate(scene.filter, 0.05);
      ImuSample gyro;
      gyro.angular_velocity = {0.0, 0.0, 0.3};
      scene.motion.process(scene.filter, gyro);
    }
    scene.filter.settle();
    look();
    leave();
    scene.addPoint(random);
  }
  void look() {
    const auto all = scene.seen(random, 1.0);
    if (!all.empty()) correct(scene.filter, all);
  }
  void leave() {
    scene.filter.deactivate(scene.points.front());
    away.push_back(scene.points.front());
    scene.points.erase(scene.points.begin());
  }
  void drive(int frames) {
    for (int i = 0; i < frames; ++i) frame();
  }
  const InactiveStore& store() const { return scene.filter.inactive(); }

  Random random;
  Scene scene;
  std::vector<Handle> away; ///< those that left first come first
};

TEST(InactiveStoreTest, EstimatesAreThoseOfTheSettledOneAndNeverTooSmall) {
  Leaving drive(1);
  for (int i = 0; i < 4; ++i) {
    drive.drive(12);
    const auto exact = drive.store().estimates(true), rough = drive.store().estimates(false);
    Filter settled = drive.scene.filter;
    settled.settleInactive();
    const auto& variables = settled.inactive().variables();
    ASSERT_EQ(exact.size(), variables.size());
    for (std::size_t k = 0; k < variables.size(); ++k) {
      const Eigen::Index row = settled.inactive().rowOf(k);
      const Eigen::Matrix3d P = settled.inactive().covariance().block(row, row, 3, 3);
      for (const auto* estimates : {&exact, &rough}) {
        const InactiveStore::Estimate& e = (*estimates)[k];
        EXPECT_EQ(e.variable.handle, variables[k].handle);
        EXPECT_EQ(e.variable.linearised, variables[k].linearised);
        EXPECT_LT(distance(e.variable.mean, variables[k].mean), 1e-9);
      }
      EXPECT_LT(worstCorrelationError(exact[k].covariance, P), 1e-9);
      Eigen::MatrixXd more = rough[k].covariance - P;
      more.diagonal().array() += 1e-9 * P.norm();
      EXPECT_EQ(Eigen::LLT<Eigen::MatrixXd>(more).info(), Eigen::Success);
    }
    drive.scene.filter.settleInactive();
  }
}

TEST(InactiveStoreTest, IsTheSameHoweverOftenItIsSettled) {
  Leaving once(2), often(2);
  for (int i = 0; i < 40; ++i) {
    once.frame();
    often.frame();
    if (i % 3 == 0) often.scene.filter.settleInactive();
  }
  EXPECT_LT(worstCorrelationError(jointOf(once.scene.filter), jointOf(often.scene.filter)), 1e-9);
  EXPECT_LT(distance(stateOf(once.scene.filter).x, stateOf(often.scene.filter).x), 1e-9);
  EXPECT_GT(once.store().settlingCost(), 0.0);
}

TEST(InactiveStoreTest, WhoLosesNothingMoreDoesNotTakeAlongWhatLeftForEver) {
  Leaving drive(3), settled(3);
  for (Leaving* each : {&drive, &settled}) each->drive(3);
  settled.scene.filter.settleInactive();
  const std::size_t before = drive.store().deferredBlocks();
  for (int i = 0; i < 300; ++i) {
    drive.look();
    settled.look();
  }
  EXPECT_EQ(drive.store().deferredBlocks(), before + 1);
  EXPECT_LT(worstCorrelationError(jointOf(drive.scene.filter), jointOf(settled.scene.filter)), 1e-9);
  EXPECT_LT(distance(stateOf(drive.scene.filter).x, stateOf(settled.scene.filter).x), 1e-9);
}

TEST(InactiveStoreTest, IsTheSameWhereAThreadSettlesWhileTheDriveGoesOn) {
  Leaving never(9), beside(9);
  for (int i = 0; i < 60; ++i) {
    never.frame();
    beside.frame();
    if (i % 20 == 10) beside.scene.filter.beginSettlingInactive();
    if (i % 20 == 18) {
      const std::size_t blocks = beside.store().deferredBlocks();
      beside.scene.filter.endSettlingInactive();
      EXPECT_LT(beside.store().deferredBlocks(), blocks);
    }
    if (i == 35) { // while the thread has them
      for (Leaving* drive : {&never, &beside})
        drive->scene.filter.activate({drive->away[3], drive->away[30]});
    }
  }
  EXPECT_GT(never.store().deferredBlocks(), beside.store().deferredBlocks());
  beside.scene.filter.beginSettlingInactive();
  const Filter copy = beside.scene.filter; // both have it
  for (const Filter& filter : {copy, beside.scene.filter}) {
    EXPECT_LT(worstCorrelationError(jointOf(filter), jointOf(never.scene.filter)), 1e-9);
    EXPECT_LT(distance(stateOf(filter).x, stateOf(never.scene.filter).x), 1e-9);
  }
}

TEST(InactiveStoreTest, ThoseThatAreAwayForLongestAreMarginalisedAndTheRestStaysExact) {
  for (const std::size_t count : {1u, 9u, 25u}) {
    Leaving drive(3);
    drive.drive(30);
    drive.scene.filter.activate({drive.away[0]}); // comes back and leaves again: the last one
    drive.scene.points.insert(drive.scene.points.begin(), drive.away[0]);
    drive.away.erase(drive.away.begin());
    drive.drive(1);
    const Filter before = drive.scene.filter;
    const std::vector<Handle> gone = drive.scene.filter.marginaliseOldest(count);
    ASSERT_GE(gone.size(), count);
    EXPECT_LE(gone.size(), count + 10) << "a block or a part of it more";
    EXPECT_TRUE(std::equal(gone.begin(), gone.end(), drive.away.begin()));
    // All others as if nothing had been.
    Filter with = before, without = drive.scene.filter;
    const std::vector<Handle> rest(drive.away.begin() + static_cast<std::ptrdiff_t>(gone.size()),
                                   drive.away.end());
    with.activate(rest);
    without.activate(rest);
    EXPECT_TRUE(without.inactive().isEmpty());
    EXPECT_LT(worstCorrelationError(without.covariance(), with.covariance()), 1e-9) << count;
    for (const Handle handle : rest)
      EXPECT_LT(distance(with.variables().point(handle), without.variables().point(handle)), 1e-9);
  }
}

TEST(InactiveStoreTest, CountsWhatLeftSince) {
  Leaving drive(4);
  drive.drive(10);
  EXPECT_EQ(drive.store().size(), 10u);
  EXPECT_EQ(drive.store().deactivatedSince(drive.away.back()), 0u);
  EXPECT_EQ(drive.store().deactivatedSince(drive.away.front()), 9u);
  EXPECT_TRUE(drive.store().contains(drive.away.front()));
  EXPECT_FALSE(drive.store().contains(drive.scene.points.front()));
  auto handles = drive.store().handles();
  std::sort(handles.begin(), handles.end());
  auto expected = drive.away;
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(handles, expected);
}

TEST(InactiveStoreTest, ACopyIsNotChangedByTheOther) {
  Leaving drive(5);
  drive.drive(20);
  drive.scene.filter.settleInactive();
  const Filter copy = drive.scene.filter;
  const Eigen::MatrixXd before = jointOf(copy);
  drive.drive(20);
  drive.scene.filter.settleInactive();
  drive.scene.filter.marginaliseOldest(5);
  EXPECT_EQ(distance(jointOf(copy), before), 0.0);
}

TEST(InactiveStoreTest, HoldsNothingWhereNothingIsInactive) {
  Leaving drive(6);
  drive.drive(10);
  drive.scene.filter.activate(drive.away);
  EXPECT_TRUE(drive.store().isEmpty());
  EXPECT_EQ(drive.store().bytes(), InactiveStore().bytes());
  EXPECT_TRUE(drive.store().estimates(true).empty());
  drive.away.clear();
  drive.drive(3);
  EXPECT_EQ(drive.scene.filter.marginaliseOldest(100).size(), 3u);
  EXPECT_EQ(drive.store().bytes(), InactiveStore().bytes());
}

TEST(InactiveStoreTest, DoesNotGrowWithTheDrive) {
  Leaving drive(7);
  std::size_t bytes = 0;
  for (int i = 0; i < 600; ++i) {
    drive.frame();
    if (drive.store().size() > 30) drive.scene.filter.marginaliseOldest(drive.store().size() - 30);
    if (i == 300) bytes = drive.store().bytes();
  }
  EXPECT_LE(drive.store().bytes(), bytes + bytes / 2);
}

TEST(InactiveStoreTest, CountsTheBytesOfWhatASettlingHasReplaced) {
  Leaving drive(9);
  const auto goOn = [&drive] {
    while (drive.store().deferredBlocks() == 0) drive.frame();
  };
  goOn();
  drive.scene.filter.beginSettlingInactive();
  drive.scene.filter.endSettlingInactive();
  goOn();
  const std::size_t bytes = drive.store().bytes();
  drive.scene.filter.beginSettlingInactive(); // which frees it
  EXPECT_LT(drive.store().bytes(), bytes);
  drive.scene.filter.endSettlingInactive();
}

TEST(InactiveStoreTest, KnowsItsVariablesOnly) {
  Leaving drive(8);
  drive.drive(2);
  const std::size_t rows = static_cast<std::size_t>(drive.scene.filter.rows());
  EXPECT_THROW(drive.scene.filter.activate({drive.away[0], drive.scene.points[0]}), std::out_of_range);
  EXPECT_THROW(drive.scene.filter.inactive().related(0), std::out_of_range); // the pose
  EXPECT_EQ(static_cast<std::size_t>(drive.scene.filter.rows()), rows);
  EXPECT_EQ(drive.store().size(), 2u);
  EXPECT_THROW(drive.store().deactivatedSince(drive.scene.points[0]), std::out_of_range);
  EXPECT_THROW(drive.scene.filter.moveWorld(SE3()), std::logic_error);
}

} // namespace
} // namespace vi_ekf_slam::test

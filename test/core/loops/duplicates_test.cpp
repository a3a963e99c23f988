#include "../filter/states.hpp"
#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/core/health/recovery.hpp"
#include "vi_ekf_slam/core/loops/fuse_matches.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr std::size_t kPairs = 6;

/// A filter that saw kPairs points, drove on, lost its way by a random error of the size of its own
/// uncertainty, and sees the same points as new ones.
struct Return {
  explicit Return(unsigned seed) : random(seed), scene(start()) {
    Filter& filter = scene.filter;
    std::vector<Handle> before;
    for (std::size_t i = 0; i < kPairs; ++i) {
      points.push_back(filter.pose() * random.vector<3>(2.0, 20.0));
      before.push_back(filter.augment(Chart::kPoint, points.back() + 0.05 * random.vector<3>(-1.0, 1.0),
                                      0.0025 * Eigen::Matrix3d::Identity()));
    }
    for (const Handle handle : before) filter.deactivate(handle);
    Vector6d drift;
    drift << 1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4;
    resetPose(filter, SE3(), drift.asDiagonal());
    filter.activate(before);
    shift = random.vector<3>(-1.0, 1.0);
    for (std::size_t i = 0; i < kPairs; ++i) {
      pairs.push_back({0, before[i]});
      see(i, 0.05 * random.vector<3>(-1.0, 1.0));
    }
  }

  static Scene start() {
    Scene scene{Filter(SE3(), 1e-4 * Matrix6d::Identity()), ConstantTwist(noisyMotion()), {}, {}};
    scene.motion.addTo(scene.filter);
    scene.filter.closeCore();
    return scene;
  }

  void see(std::size_t point, const Eigen::Vector3d& by) {
    pairs[point].now =
        scene.filter.augment(Chart::kPoint, points[point] + shift + by, 0.0025 * Eigen::Matrix3d::Identity());
  }
  /// Moves what is seen now of a point somewhere else.
  void leadAstray(std::size_t point, const Eigen::Vector3d& by) {
    scene.filter.remove(pairs[point].now);
    see(point, by);
  }

  Random random;
  Scene scene;
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d shift;
  std::vector<Duplicate> pairs;
};

TEST(Duplicates, AreOnePointAndTakeThePoseBack) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Return loop(seed);
    Filter& filter = loop.scene.filter;
    const Eigen::MatrixXd before = filter.covariance(0);
    EXPECT_EQ(countTrue(fuseDuplicates(filter, loop.pairs, 3, 1e-3)), kPairs) << seed;
    for (std::size_t i = 0; i < kPairs; ++i) {
      const Eigen::Vector3d now = filter.variables().point(loop.pairs[i].now);
      EXPECT_LT(distance(now, filter.variables().point(loop.pairs[i].before)), 0.01);
      EXPECT_LT(distance(now, loop.points[i]), 0.5) << seed;
    }
    // The pose, which knew nothing of its shift, was taken back, and knows it.
    EXPECT_LT(distance(filter.pose().translation(), -loop.shift), 0.3) << seed;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LT(filter.covariance(0)(axis, axis), 0.2 * before(axis, axis));
    expectCovariance(filter.covariance());
  }
}

TEST(Duplicates, LeaveOutWhatIsNotWhereItWas) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Return loop(seed);
    loop.leadAstray(2, {2.0, -1.0, 0.5});
    loop.leadAstray(4, {-1.5, 0.3, 0.8});
    const std::vector<bool> fused = fuseDuplicates(loop.scene.filter, loop.pairs, 3, 1e-3);
    EXPECT_EQ(fused, (std::vector<bool>{true, true, false, true, false, true})) << seed;
  }
}

TEST(Duplicates, AreNotFusedWhereTooFewAgree) {
  Return loop(3);
  for (std::size_t i = 0; i < kPairs; ++i)
    loop.leadAstray(i, {3.0 * static_cast<double>(i % 3), 2.0 * static_cast<double>(i / 3), 0.0});
  Filter& filter = loop.scene.filter;
  const Eigen::MatrixXd before = filter.covariance();
  const State state = stateOf(filter);
  EXPECT_EQ(countTrue(fuseDuplicates(filter, loop.pairs, 3, 1e-3)), 0u);
  EXPECT_EQ(distance(filter.covariance(), before), 0.0);
  EXPECT_EQ(distance(stateOf(filter).x, state.x), 0.0);
  EXPECT_EQ(countTrue(fuseDuplicates(filter, {}, 1, 1e-3)), 0u);
}

TEST(Duplicates, DoNotProveAShiftThatTheFilterThinksImpossible) {
  Return loop(4);
  for (std::size_t i = 0; i < kPairs; ++i) loop.leadAstray(i, {40.0, 0.0, 0.0}); // they all agree
  EXPECT_EQ(countTrue(fuseDuplicates(loop.scene.filter, loop.pairs, 3, 1e-3)), 0u);
}

// The estimates that are fused were independent: errors are what the covariance says before and after.
TEST(Duplicates, LeaveAnErrorOfTheSizeOfItsCovariance) {
  double squared = 0.0;
  constexpr unsigned kRuns = 60;
  for (unsigned seed = 1; seed <= kRuns; ++seed) {
    Return loop(100 + seed);
    Filter& filter = loop.scene.filter;
    ASSERT_EQ(countTrue(fuseDuplicates(filter, loop.pairs, 3, 1e-3)), kPairs);
    // Uniform errors of 0.05 have a variance of a third of what is told.
    const Eigen::Vector3d error = filter.pose().translation() + loop.shift;
    squared += error.dot(inverseOf(filter.covariance(0).topLeftCorner<3, 3>()) * error) / 3.0 / kRuns;
  }
  EXPECT_LT(squared, 1.2);
  EXPECT_GT(squared, 0.05);
}

} // namespace
} // namespace vi_ekf_slam::test

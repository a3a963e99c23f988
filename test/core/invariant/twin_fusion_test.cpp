#include "vi_ekf_slam/core/invariant/twin_fusion.hpp"

#include <algorithm>

#include "states.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

constexpr std::size_t kPoints = 6;

/// A state that saw kPoints landmarks, drove on, lost its way by a random error of the size of its own
/// uncertainty, and sees the same points as new landmarks: those before come first.
struct Return {
  explicit Return(unsigned seed) : random(seed), state(kPrior, true) {
    std::vector<FeatureId> ids;
    for (std::size_t i = 0; i < kPoints; ++i) {
      points.push_back(state.pose() * random.vector<3>(2.0, 20.0));
      state.addLandmark(i, points.back() + 0.05 * random.vector<3>(-1.0, 1.0),
                        0.0025 * Eigen::Matrix3d::Identity());
      ids.push_back(i);
    }
    while (!state.landmarks().empty()) state.deactivateLandmark(0);
    Matrix6d drift = Matrix6d::Zero();
    drift.diagonal() << 1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4;
    state.loosen(drift);
    state.activateLandmarks(ids);
    shift = random.vector<3>(-1.0, 1.0);
    for (std::size_t i = 0; i < kPoints; ++i) {
      twins.push_back({state.landmarks().size(), i});
      state.addLandmark(100 + i, points[i] + shift + 0.05 * random.vector<3>(-1.0, 1.0),
                        0.0025 * Eigen::Matrix3d::Identity());
    }
  }

  /// Moves what is seen now of a point somewhere else.
  void leadAstray(std::size_t point, const Eigen::Vector3d& by) {
    state.removeLandmark(twins[point].now);
    twins[point].now = state.landmarks().size();
    for (std::size_t i = 0; i < kPoints; ++i) { // the last one took its place
      for (std::size_t k = kPoints; k < state.landmarks().size(); ++k) {
        if (state.landmarks()[k].id == 100 + i) twins[i].now = k;
      }
    }
    state.addLandmark(100 + point, points[point] + shift + by, 0.0025 * Eigen::Matrix3d::Identity());
  }

  std::ptrdiff_t count(const TwinFusion& fusion) const {
    return std::count(fusion.fused.begin(), fusion.fused.end(), true);
  }

  Random random;
  State state;
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d shift;
  std::vector<Twin> twins;
};

TEST(TwinFusion, TellsThatTwoLandmarksAreOne) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Return loop(seed);
    const Eigen::Vector3d before = loop.state.poseCovariance().diagonal().head<3>();
    const TwinFusion fusion = fuseTwins(loop.state, loop.twins, 3, 1e-3);
    EXPECT_EQ(loop.count(fusion), 6) << seed;
    EXPECT_EQ(fusion.dof, 18u);
    EXPECT_LT(fusion.nis, 2.0 * 18.0);
    for (const Twin& twin : loop.twins) {
      EXPECT_LT(
          distance(loop.state.landmarks()[twin.now].position, loop.state.landmarks()[twin.before].position),
          0.01);
      const auto i = static_cast<std::size_t>(&twin - loop.twins.data());
      EXPECT_LT(distance(loop.state.landmarks()[twin.now].position, loop.points[i]), 0.5) << seed;
    }
    // The pose, which knew nothing of its shift, was taken back, and knows it.
    EXPECT_LT(distance(loop.state.pose().translation(), -loop.shift), 0.3) << seed;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LT(loop.state.poseCovariance()(axis, axis), 0.2 * before[axis]);
  }
}

TEST(TwinFusion, LeavesOutWhatIsNotWhereItWas) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Return loop(seed);
    loop.leadAstray(2, {2.0, -1.0, 0.5});
    loop.leadAstray(4, {-1.5, 0.3, 0.8});
    const TwinFusion fusion = fuseTwins(loop.state, loop.twins, 3, 1e-3);
    EXPECT_EQ(fusion.fused, (PooledVector<bool>{true, true, false, true, false, true})) << seed;
  }
}

TEST(TwinFusion, FusesNothingWhereTooFewAgree) {
  Return loop(3);
  for (std::size_t i = 0; i < kPoints; ++i)
    loop.leadAstray(i, {3.0 * static_cast<double>(i % 3), 2.0 * static_cast<double>(i / 3), 0.0});
  const Eigen::MatrixXd before = loop.state.covariance();
  const TwinFusion fusion = fuseTwins(loop.state, loop.twins, 3, 1e-3);
  EXPECT_EQ(loop.count(fusion), 0);
  EXPECT_EQ(fusion.dof, 0u);
  EXPECT_EQ(distance(loop.state.covariance(), before), 0.0);
  EXPECT_EQ(loop.count(fuseTwins(loop.state, {}, 1, 1e-3)), 0);
}

TEST(TwinFusion, DoesNotBelieveAShiftThatTheStateThinksImpossible) {
  Return loop(4);
  for (std::size_t i = 0; i < kPoints; ++i) loop.leadAstray(i, {40.0, 0.0, 0.0}); // they all agree
  EXPECT_EQ(loop.count(fuseTwins(loop.state, loop.twins, 3, 1e-3)), 0);
}

} // namespace
} // namespace vi_ekf_slam::invariant

#include <algorithm>
#include <vector>

#include "states.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InvariantState, AddsALandmarkThatMovesWithThePose) {
  Random random(6);
  State state = busyState(random, 2);
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::Matrix3d noise = random.covariance<3>();
  state.addLandmark(99, {1.0, 2.0, 3.0}, noise);
  // The new state is [I; (I 0 ... 0)] times the old one plus noise.
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(state.size(), P.cols());
  A.topRows(P.rows()).setIdentity();
  A.bottomRows<3>().leftCols<3>().setIdentity();
  Eigen::MatrixXd expected = A * P * A.transpose();
  expected.bottomRightCorner<3, 3>() += noise;
  EXPECT_LT(distance(state.covariance(), expected), 1e-14);
  EXPECT_EQ(state.landmarks().back().id, 99u);
  EXPECT_EQ(state.landmarks().back().observations, 1u);
  state.addObservations(2, 1);
  EXPECT_EQ(state.landmarks().back().observations, 2u);
}

TEST(InvariantState, RemovingALandmarkLeavesTheMarginal) {
  Random random(7);
  for (std::size_t gone = 0; gone < 4; ++gone) {
    State state = busyState(random, 4);
    const State before = state;
    state.removeLandmark(gone);
    ASSERT_EQ(state.landmarks().size(), 3u);
    std::vector<Eigen::Index> from;
    for (Eigen::Index i = 0; i < kLandmarks; ++i) from.push_back(i);
    for (const Landmark& l : state.landmarks()) {
      const auto old = std::find_if(before.landmarks().begin(), before.landmarks().end(),
                                    [&](const Landmark& other) { return other.id == l.id; });
      ASSERT_NE(old, before.landmarks().end());
      EXPECT_EQ(distance(old->position, l.position), 0.0);
      const auto index = static_cast<std::size_t>(old - before.landmarks().begin());
      EXPECT_NE(index, gone);
      for (Eigen::Index k = 0; k < 3; ++k) from.push_back(State::offsetOf(index) + k);
    }
    const Eigen::MatrixXd P = before.covariance(), Q = state.covariance();
    for (Eigen::Index i = 0; i < Q.rows(); ++i) {
      for (Eigen::Index j = 0; j < Q.cols(); ++j) {
        EXPECT_NEAR(Q(i, j), P(from[static_cast<std::size_t>(i)], from[static_cast<std::size_t>(j)]), 1e-13);
      }
    }
  }
}

TEST(InvariantState, GrowsBeyondItsFirstCapacityAndKeepsWhatItKnows) {
  Random random(8);
  State state = busyState(random, 1);
  const Eigen::MatrixXd P = state.covariance();
  for (FeatureId id = 100; id < 500; ++id) {
    state.addLandmark(id, Eigen::Vector3d::Constant(static_cast<double>(id)), Eigen::Matrix3d::Identity());
  }
  ASSERT_EQ(state.size(), kLandmarks + 3 * 401);
  EXPECT_EQ(distance(state.covariance().topLeftCorner(P.rows(), P.cols()), P), 0.0);
  EXPECT_TRUE(state.covariance().allFinite());
  const Eigen::MatrixXd grown = state.covariance();
  EXPECT_LT(distance(grown, grown.transpose()), 1e-15);
  while (state.landmarks().size() > 1) state.removeLandmark(1);
  EXPECT_EQ(distance(state.covariance(), P), 0.0);
}

} // namespace
} // namespace vi_ekf_slam::invariant

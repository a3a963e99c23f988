#include "vi_ekf_slam/core/invariant/relative_update.hpp"

#include <Eigen/Cholesky>

#include "states.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

const Eigen::Matrix3d kPixels = Eigen::Vector3d(1.3, 0.65, 1.3).asDiagonal();

/// Of so many rows, each three independent of the others.
Eigen::MatrixXd noiseOf(Eigen::Index rows) {
  Eigen::MatrixXd R = Eigen::MatrixXd::Zero(rows, rows);
  for (Eigen::Index row = 0; row < rows; row += 3) R.block<3, 3>(row, row) = kPixels;
  return R;
}

/// Some landmarks of a state, measured as a stereo pair does, one after the other as `seen` has them.
struct Measured {
  Measured(Random& random, const State& state, const std::vector<std::size_t>& seen)
      : H(rowsOf(seen.size())), dense(Eigen::MatrixXd::Zero(H.rows(), state.size())) {
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Eigen::Matrix3d J = 100.0 * (Eigen::Matrix3d::Identity() + 0.3 * randomMatrix(random, 3, 3));
      add(i, State::offsetOf(seen[i]), J);
    }
  }

  void add(std::size_t i, Eigen::Index column, const Eigen::Matrix3d& J) {
    H.add(rowsOf(i), column, J);
    H.add(rowsOf(i), kPosition, -J);
    dense.block<3, 3>(rowsOf(i), column) = J;
    dense.block<3, 3>(rowsOf(i), kPosition) = -J;
  }

  /// What the update is made of.
  std::optional<RelativeUpdate> update(const State& state) const {
    const Update update = updateOf(state, dense, noiseOf(H.rows()));
    return RelativeUpdate::make(H, kPixels, update.PHt, Eigen::MatrixXd(update.S.llt().matrixL()));
  }

  SparseRows H;
  Eigen::MatrixXd dense;
};

TEST(RelativeUpdate, IsTheKalmanUpdateWhateverTheOrderAndWhoeverIsNotSeen) {
  Random random(1);
  for (const std::vector<std::size_t>& seen : {std::vector<std::size_t>{0, 1, 2, 3, 4, 5, 6, 7},
                                               {7, 0, 3, 1, 6, 2, 4, 9},
                                               {9, 2, 8, 5, 0, 1, 3, 4}}) {
    const State state = busyState(random, 10);
    const Measured measured(random, state, seen);
    const auto update = measured.update(state);
    auto with_gain = update;
    ASSERT_TRUE(update);
    EXPECT_TRUE(update->isFinite());
    const Eigen::MatrixXd P = state.covariance();
    const Eigen::MatrixXd S = measured.dense * P * measured.dense.transpose() + noiseOf(measured.H.rows());
    const Eigen::MatrixXd K = P * measured.dense.transpose() * inverseOf(S);
    EXPECT_LT(relativeDistance(with_gain->transposedGain(), K.transpose()), 1e-9);

    Eigen::MatrixXd still = P;
    update->correct(still, {});
    Eigen::MatrixXd expected = P - K * S * K.transpose();
    EXPECT_LT(relativeDistance(still, expected), 1e-9);
    EXPECT_EQ(distance(still, still.transpose()), 0.0);
    Eigen::MatrixXd after_gain = P;
    with_gain->correct(after_gain, {});
    EXPECT_EQ(distance(after_gain, still), 0.0);

    PooledVector<Eigen::Matrix3d> M;
    Eigen::MatrixXd T = Eigen::MatrixXd::Identity(P.rows(), P.cols());
    for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
      M.push_back(Eigen::Matrix3d::Identity() + 0.1 * randomMatrix(random, 3, 3));
      T.block<3, 3>(State::offsetOf(i), State::offsetOf(i)) = M.back();
      T.block<3, 3>(State::offsetOf(i), kPosition) = Eigen::Matrix3d::Identity() - M.back();
    }
    Eigen::MatrixXd moved = P;
    update->correct(moved, M);
    EXPECT_LT(relativeDistance(moved, T * expected * T.transpose()), 1e-9);
    EXPECT_EQ(distance(moved, moved.transpose()), 0.0);
  }
}

TEST(RelativeUpdate, IsForMostLandmarksSeenOnceEachFromTheBodyOnly) {
  Random random(2);
  const State state = busyState(random, 10);
  const auto isMade = [&](const Measured& measured) { return measured.update(state).has_value(); };
  EXPECT_TRUE(isMade(Measured(random, state, {0, 1, 2, 3, 4, 5, 6, 7})));
  EXPECT_FALSE(isMade(Measured(random, state, {0, 1, 2}))) << "few";
  EXPECT_FALSE(isMade(Measured(random, state, {0, 1, 2, 3, 4, 5, 6, 6}))) << "one twice";
  Measured flat(random, state, {0, 1, 2, 3, 4, 5, 6});
  Measured twist(random, state, {0, 1, 2, 3, 4, 5, 6});
  Measured other(random, state, {0, 1, 2, 3, 4, 5, 6});
  const auto more = [](Measured& measured) {
    SparseRows H(measured.H.rows() + 3);
    for (const SparseRows::Block& block : measured.H.blocks()) H.add(block.row, block.column, block.value);
    measured.H = H;
    measured.dense.conservativeResize(H.rows(), Eigen::NoChange);
    measured.dense.bottomRows<3>().setZero();
  };
  more(flat);
  flat.add(7, State::offsetOf(7), Eigen::Vector3d(100.0, 100.0, 1e-7).asDiagonal());
  EXPECT_FALSE(isMade(flat)) << "a depth that is not seen";
  more(twist);
  twist.add(7, kTwist, Eigen::Matrix3d::Identity());
  EXPECT_FALSE(isMade(twist)) << "no landmark";
  more(other);
  other.H.add(21, State::offsetOf(7), Eigen::Matrix3d::Identity());
  other.H.add(21, State::offsetOf(8), -Eigen::Matrix3d::Identity());
  EXPECT_FALSE(isMade(other)) << "one landmark from another";
}

TEST(RelativeUpdate, LosesNothingWhereTheLandmarksAreKnownFarBetterThanMeasured) {
  Random random(3);
  State fast = busyState(random, 8), slow = fast;
  const Measured measured(random, fast, {0, 1, 2, 3, 4, 5, 6, 7});
  const Eigen::MatrixXd R = noiseOf(24);
  for (int i = 0; i < 3000; ++i) {
    for (State* state : {&fast, &slow}) {
      state->propagate(0.1, kNoise);
      const Update update = updateOf(*state, measured.dense, R);
      const Correction correction(update.PHt, update.S, Eigen::VectorXd::Zero(24),
                                  state == &fast ? measured.H : SparseRows(0), Eigen::Matrix3d(kPixels));
      ASSERT_TRUE(state->apply(correction));
    }
  }
  expectCovariance(fast);
  const Eigen::VectorXd sigma = slow.covariance().diagonal().cwiseSqrt().cwiseInverse();
  const auto correlation = [&](const State& state) -> Eigen::MatrixXd {
    return sigma.asDiagonal() * state.covariance() * sigma.asDiagonal();
  };
  EXPECT_LT((correlation(fast) - correlation(slow)).cwiseAbs().maxCoeff(), 1e-8);
}

} // namespace
} // namespace vi_ekf_slam::invariant

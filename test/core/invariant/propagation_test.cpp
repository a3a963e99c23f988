#include <cmath>

#include "states.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InvariantState, StartsAtTheOriginWithItsPrior) {
  const State state(kPrior);
  EXPECT_EQ(distance(state.pose().matrix(), Eigen::Matrix4d::Identity()), 0.0);
  EXPECT_EQ(state.size(), kLandmarks);
  Eigen::VectorXd sigma(18);
  sigma << kPrior.pose_sigma, kPrior.twist_sigma, kPrior.bias_sigma;
  const Eigen::MatrixXd expected = sigma.cwiseAbs2().asDiagonal();
  EXPECT_EQ(distance(state.covariance(), expected), 0.0);
}

TEST(InvariantState, PropagatesTheErrorAsTheExactDynamicsDo) {
  Random random(1);
  for (int run = 0; run < 5; ++run) {
    State state = busyState(random);
    const Mean before = meanOf(state);
    const Eigen::MatrixXd P = state.covariance();
    const double dt = random.uniform(0.02, 0.3);
    const Eigen::MatrixXd F = derivative(
        [&](const Eigen::VectorXd& error) {
          return errorOf(moved(truthAt(before, error), dt), moved(before, dt));
        },
        state.size());
    state.propagate(dt, kNoNoise);
    EXPECT_LT(distance(state.pose().matrix(), moved(before, dt).pose.matrix()), 1e-12);
    EXPECT_LT(relativeDistance(state.covariance(), F * P * F.transpose()), 1e-8);
    EXPECT_LT(distance(F * gauge(state), gauge(state)), 1e-8);
    expectCovariance(state);
  }
}

TEST(InvariantState, AddsTheSameNoiseInOneStepAsInTen) {
  // At rest the map from twist to pose is constant, and both are exact.
  State one(kPrior);
  one.addLandmark(1, {5.0, 2.0, 1.0}, 0.1 * Eigen::Matrix3d::Identity());
  State ten = one;
  one.propagate(1.0, kNoise);
  for (int i = 0; i < 10; ++i) ten.propagate(0.1, kNoise);
  EXPECT_LT(distance(one.covariance(), ten.covariance()), 1e-13);
  const Vector6d Q = kNoise.twist_density.cwiseAbs2();
  const Vector6d prior = kPrior.twist_sigma.cwiseAbs2();
  const Eigen::MatrixXd P = one.covariance();
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(P(kTwist + i, kTwist + i), prior[i] + Q[i], 1e-13);
    EXPECT_NEAR(P(i, i), 0.01 + prior[i] + Q[i] / 3.0, 1e-13);
    EXPECT_NEAR(P(i, kTwist + i), prior[i] + Q[i] / 2.0, 1e-13);
    EXPECT_NEAR(P(kBias + i, kBias + i), 0.0004 + std::pow(kNoise.bias_density[i], 2), 1e-13);
  }
}

TEST(InvariantState, NoiseDoesNotDependOnTheStepToFirstOrder) {
  Random random(2);
  const State start = busyState(random);
  const auto difference = [&](double dt) {
    // The noise alone: what it adds to the propagation without.
    const auto added = [&](int steps) {
      State with = start, without = start;
      for (int i = 0; i < steps; ++i) {
        with.propagate(dt / steps, kNoise);
        without.propagate(dt / steps, kNoNoise);
      }
      return Eigen::MatrixXd(with.covariance() - without.covariance());
    };
    const Eigen::MatrixXd one = added(1), ten = added(10);
    // Block by block, since they are of different orders in dt.
    return Eigen::Vector3d(
        relativeDistance(one.block<6, 6>(0, 0), ten.block<6, 6>(0, 0)),
        relativeDistance(one.block<6, 6>(0, kTwist), ten.block<6, 6>(0, kTwist)),
        relativeDistance(one.block<6, 6>(kTwist, kTwist), ten.block<6, 6>(kTwist, kTwist)));
  };
  const Eigen::Vector3d coarse = difference(0.02), fine = difference(0.01);
  EXPECT_LT(coarse.maxCoeff(), 0.05);
  for (int i = 0; i < 3; ++i) EXPECT_LE(fine[i], 0.6 * coarse[i] + 1e-9);
}

/// `noise` with the other's added.
ProcessNoise sum(const ProcessNoise& a, const ProcessNoise& b) {
  return {(a.twist_density.cwiseAbs2() + b.twist_density.cwiseAbs2()).cwiseSqrt(),
          (a.bias_density.cwiseAbs2() + b.bias_density.cwiseAbs2()).cwiseSqrt()};
}

TEST(InvariantState, IsDisturbedAfterwardsAsIfTheNoiseHadBeenThere) {
  Random random(18);
  const ProcessNoise more{(Vector6d() << 0.3, 0.2, 0.1, 0.4, 0.5, 0.6).finished(), Vector6d::Constant(0.01)};
  for (const double dt : {0.02, 0.1, 0.5}) {
    State afterwards = busyState(random);
    State at_once = afterwards;
    at_once.propagate(dt, sum(kNoise, more));
    afterwards.propagate(dt, kNoise);
    const State before = afterwards;
    afterwards.disturb(dt, more);
    EXPECT_LT(relativeDistance(afterwards.covariance(), at_once.covariance()), 1e-10) << dt;
    // The mean stays.
    EXPECT_EQ(distance(afterwards.pose().matrix(), before.pose().matrix()), 0.0);
    EXPECT_EQ(distance(afterwards.twist(), before.twist()), 0.0);
    EXPECT_EQ(distance(afterwards.bias(), before.bias()), 0.0);
    for (std::size_t i = 0; i < before.landmarks().size(); ++i) {
      EXPECT_EQ(distance(afterwards.landmarks()[i].position, before.landmarks()[i].position), 0.0);
    }
    expectCovariance(afterwards);
    // Nothing is known better by it.
    const Eigen::MatrixXd added = afterwards.covariance() - before.covariance();
    EXPECT_TRUE(isPositive(added, 1e-12)) << dt;
    EXPECT_GT(afterwards.covariance()(kTwist, kTwist), before.covariance()(kTwist, kTwist));
  }
}

TEST(InvariantState, IsNotDisturbedByNoNoise) {
  Random random(19);
  State state = busyState(random);
  const Eigen::MatrixXd before = state.covariance();
  state.disturb(0.1, kNoNoise);
  EXPECT_EQ(distance(state.covariance(), before), 0.0);
}

} // namespace
} // namespace vi_ekf_slam::invariant

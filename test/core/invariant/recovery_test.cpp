#include <algorithm>
#include <array>

#include "road.hpp"
#include "states.hpp"
#include "vi_ekf_slam/simulation/consistency.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InvariantState, IsDisplacedAsItsErrorIsDefined) {
  Random random(1);
  for (int run = 0; run < 5; ++run) {
    State state = busyState(random);
    const Eigen::MatrixXd P = state.covariance();
    const SE3 motion = SE3::Exp(random.vector<6>(-1.0, 1.0));
    const Matrix6d Q = random.covariance<6>();
    Mean estimate = meanOf(state);
    estimate.pose = estimate.pose * motion;
    // How the error answers to the body being shifted and turned along the world axes, the landmarks staying.
    const Eigen::MatrixXd G = derivative(
        [&](const Eigen::VectorXd& d) {
          Mean truth = estimate;
          truth.pose = SE3(so3::Exp(d.tail<3>()) * estimate.pose.rotation(),
                           estimate.pose.translation() + d.head<3>());
          return errorOf(truth, estimate);
        },
        6);
    state.displace(motion, Q);
    EXPECT_LT(distance(state.pose().matrix(), estimate.pose.matrix()), 1e-12);
    EXPECT_LT(relativeDistance(state.covariance(), P + G * Q * G.transpose()), 1e-8);
    expectCovariance(state);
  }
}

struct Outcome {
  std::array<int, kDivergenceCount> counts{};
  double largest_nees = 0.0; ///< of the pose, 6 degrees of freedom
};

/// Drives on, and says what the frames reported.
Outcome drive(Road& road, InvariantEstimator& estimator, int frames) {
  Outcome outcome;
  for (int i = 0; i < frames; ++i) {
    const FrameReport report = road.feed(estimator);
    ++outcome.counts[static_cast<std::size_t>(report.divergence)];
    outcome.largest_nees =
        std::max(outcome.largest_nees, simulation::poseNees(road.truth(), estimator.state()).pose);
  }
  return outcome;
}

int count(const Outcome& outcome, Divergence divergence) {
  return outcome.counts[static_cast<std::size_t>(divergence)];
}

TEST(Recovery, IsNotCalledForOnAnOrdinaryDrive) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 40, kTypical);
    InvariantEstimator estimator = makeEstimator();
    EXPECT_EQ(count(drive(road, estimator, 300), Divergence::kNone), 300) << seed;
  }
}

TEST(Recovery, FollowsADisplacedVehicleAndSaysSo) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 80, kTypical, 80.0);
    InvariantEstimator estimator = driven(road, 50);
    road.displace(SE3(so3::Exp({0.0, 0.0, 0.05}), {20.0, 1.0, 0.2}));
    const Outcome outcome = drive(road, estimator, 100);
    EXPECT_EQ(count(outcome, Divergence::kJump), 1) << seed;
    EXPECT_EQ(count(outcome, Divergence::kNone), 99) << seed;
    EXPECT_LT(positionError(estimator, road.truth()), 6.0) << seed;
    EXPECT_LT(outcome.largest_nees, 25.0) << seed;
  }
}

TEST(Recovery, LeavesADisplacedVehicleWhereItWasWhenTold) {
  InvariantConfig config;
  config.divergence_jump_m = 0.0;
  Road road(1, 80, kTypical, 80.0);
  InvariantEstimator estimator = driven(road, 50, config);
  road.displace(SE3(Eigen::Matrix3d::Identity(), {20.0, 0.0, 0.0}));
  const Outcome outcome = drive(road, estimator, 100);
  EXPECT_EQ(count(outcome, Divergence::kNone), 100);
  EXPECT_GT(positionError(estimator, road.truth()), 15.0);
  EXPECT_GT(outcome.largest_nees, 100.0);
}

TEST(Recovery, KeepsItsCovarianceHonestWhileTheGyroLies) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 60, kTypical);
    InvariantEstimator estimator = driven(road, 100);
    road.setGyroBias({0.0, 0.0, 1.0}); // rad/s, for 4 s
    const Outcome lying = drive(road, estimator, 40);
    EXPECT_LT(count(lying, Divergence::kNone), 40) << seed;
    road.setGyroBias(Eigen::Vector3d::Zero());
    drive(road, estimator, 30);
    const Outcome after = drive(road, estimator, 100);
    EXPECT_EQ(count(after, Divergence::kNone), 100) << seed;
    EXPECT_LT(after.largest_nees, 25.0) << seed;
    EXPECT_NEAR(estimator.state().twist[5], road.twist()[5], 0.05) << seed;
  }
}

TEST(Recovery, BuildsABrokenCovarianceAnew) {
  Road road(1, 40, kTypical);
  InvariantEstimator estimator = driven(road, 100);
  // Noise that is none: it leaves S positive and makes P - P H^T S^-1 H P negative.
  GyroSample lie = road.gyro();
  lie.covariance = -0.9 * estimator.state().twist_covariance.bottomRightCorner<3, 3>();
  estimator.process(lie);
  EXPECT_TRUE(isPositiveDefinite(estimator.state().pose_covariance));
  EXPECT_TRUE(isPositiveDefinite(estimator.state().twist_covariance));
  EXPECT_LT(positionError(estimator, road.pose()), 5.0);
  const Outcome outcome = drive(road, estimator, 100);
  EXPECT_EQ(count(outcome, Divergence::kCovariance), 1);
  EXPECT_EQ(count(outcome, Divergence::kNone), 99);
  EXPECT_LT(outcome.largest_nees, 25.0);
}

} // namespace
} // namespace vi_ekf_slam::invariant

#include "vi_ekf_slam/core/invariant/drift.hpp"

#include <algorithm>
#include <vector>

#include "road.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

constexpr double kPosition2 = 1e-4, kRotation2 = 4e-6; // the two densities below, squared
const Eigen::Vector3d kFar(300.0, -120.0, 15.0);

Drift makeDrift() { return Drift(0.01, 0.002); }

TEST(Drift, IsNoneBeforeTheDriveAndWithoutDensities) {
  EXPECT_EQ(distance(makeDrift().ofPose(kFar), Matrix6d::Zero()), 0.0);
  Drift none(0.0, 0.0);
  none.drive(Eigen::Vector3d::Zero(), 100.0);
  none.drive(kFar, 100.0);
  EXPECT_EQ(distance(none.ofPose(kFar), Matrix6d::Zero()), 0.0);
}

TEST(Drift, GrowsWithTheDistanceDriven) {
  Drift once = makeDrift(), often = makeDrift();
  once.drive(kFar, 50.0);
  for (int i = 0; i < 100; ++i) often.drive(kFar, 0.5);
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(50.0 * kPosition2), Eigen::Vector3d::Constant(50.0 * kRotation2);
  const Matrix6d expected = variances.asDiagonal();
  EXPECT_LT(distance(once.ofPose(kFar), expected), 1e-12);
  EXPECT_LT(distance(often.ofPose(kFar), expected), 1e-12);
}

TEST(Drift, TurnsWhatIsFarAwayByItsLeverArm) {
  Drift drift = makeDrift();
  drift.drive(kFar, 50.0);
  const double sideways = 50.0 * kPosition2 + 50.0 * kRotation2 * 40.0 * 40.0;
  const Eigen::Matrix3d expected =
      Eigen::Vector3d(sideways, 50.0 * kPosition2, sideways).asDiagonal(); // 40 m away along y
  EXPECT_LT(distance(drift.ofPoint(kFar + Eigen::Vector3d(0.0, 40.0, 0.0)), expected), 1e-10);
}

TEST(Drift, TurningAboutTheVehicleLeavesItWhereItIs) {
  Drift drift = makeDrift();
  const Eigen::Vector3d variances(0.01, 0.02, 0.03);
  drift.turn(kFar, variances);
  Matrix6d expected = Matrix6d::Zero();
  expected.diagonal().tail<3>() = variances;
  EXPECT_LT(distance(drift.ofPose(kFar), expected), 1e-11);
  EXPECT_LT(distance(drift.ofPoint(kFar), Eigen::Matrix3d::Zero()), 1e-11);
}

TEST(Drift, IsTheSameForAPointAsForAPoseThere) {
  Random random(1);
  Drift drift = makeDrift();
  for (int i = 0; i < 50; ++i) {
    drift.drive(random.vector<3>(-100.0, 100.0), 5.0);
    drift.turn(random.vector<3>(-100.0, 100.0), random.vector<3>(0.0, 1e-5));
    const Eigen::Vector3d where = random.vector<3>(-200.0, 200.0);
    const Matrix6d pose = drift.ofPose(where);
    EXPECT_EQ(distance(drift.ofPoint(where), pose.topLeftCorner<3, 3>()), 0.0);
    EXPECT_LT(distance(pose, pose.transpose()), 1e-12 * pose.cwiseAbs().maxCoeff());
    EXPECT_TRUE(isPositive(pose, 1e-12));
  }
}

TEST(Drift, DoesNotCareInWhichOrderTheWorldTurnedAndSlid) {
  Drift one = makeDrift(), other = makeDrift();
  const Eigen::Vector3d there(10.0, 80.0, -3.0), variances(1e-4, 2e-4, 3e-4);
  one.drive(kFar, 50.0);
  one.turn(there, variances);
  one.drive(there, 7.0);
  other.drive(there, 7.0);
  other.turn(there, variances);
  other.drive(kFar, 50.0);
  EXPECT_LT(relativeDistance(one.ofPose({-20.0, 0.0, 0.0}), other.ofPose({-20.0, 0.0, 0.0})), 1e-12);
}

TEST(Drift, IsTheCovarianceOfAWorldThatTurnsAndSlidesAboutTheVehicleAtRandom) {
  Random random(2);
  std::normal_distribution<double> normal;
  const auto draw = [&](double sigma) -> Eigen::Vector3d {
    return sigma * Eigen::Vector3d(normal(random.engine()), normal(random.engine()), normal(random.engine()));
  };
  constexpr int kSteps = 20, kDraws = 20000;
  constexpr double kStep = 8.0; // m
  const auto position = [](int step) { return Eigen::Vector3d(kStep * step, 0.5 * step * step, 0.1 * step); };
  Drift drift = makeDrift();
  for (int step = 0; step < kSteps; ++step) drift.drive(position(step), kStep);
  const Eigen::Vector3d end = position(kSteps);
  Matrix6d expected = drift.ofPose(end), sampled = Matrix6d::Zero();
  for (int run = 0; run < kDraws; ++run) {
    SE3 moved; // where the world seems to be
    for (int step = 0; step < kSteps; ++step) {
      const Eigen::Matrix3d R = so3::Exp(draw(std::sqrt(kStep * kRotation2)));
      const Eigen::Vector3d p = position(step);
      moved = SE3(R, p - R * p + draw(std::sqrt(kStep * kPosition2))) * moved;
    }
    Vector6d error;
    error << moved * end - end, so3::Log(moved.rotation());
    sampled += error * error.transpose() / kDraws;
  }
  // Axis by axis in units of its own sigma; 20000 draws tell a variance to 1 %.
  const Vector6d scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  expected = scale.asDiagonal() * expected * scale.asDiagonal();
  sampled = scale.asDiagonal() * sampled * scale.asDiagonal();
  EXPECT_LT(distance(sampled, expected), 0.05);
}

TEST(InvariantEstimator, EstimatesTheSameWhateverDriftItOwnsUpTo) {
  InvariantConfig none, much;
  none.drift_position = none.drift_rotation = 0.0;
  much.drift_position = 0.1;
  much.drift_rotation = 0.01;
  Road road(30, 30, kTypical), same(30, 30, kTypical);
  InvariantEstimator without = makeEstimator(none), with = makeEstimator(much);
  for (int i = 0; i < 300; ++i) {
    const FrameReport a = road.feed(without), b = same.feed(with);
    const StateEstimate x = without.state(), y = with.state();
    ASSERT_LT(distance(x.world_T_imu.matrix(), y.world_T_imu.matrix()), 1e-9) << i;
    ASSERT_LT(distance(x.twist, y.twist), 1e-9) << i;
    ASSERT_LT(distance(x.twist_covariance, y.twist_covariance), 1e-9) << i;
    ASSERT_NEAR(a.nis, b.nis, 1e-6) << i;
    ASSERT_EQ(a.used, b.used) << i;
  }
  const auto map = without.landmarks(), other = with.landmarks();
  ASSERT_EQ(map.size(), other.size());
  for (std::size_t i = 0; i < map.size(); ++i) {
    ASSERT_LT(distance(map[i].position, other[i].position), 1e-9);
    EXPECT_GT(other[i].covariance.trace(), map[i].covariance.trace());
  }
  // 240 m: what is owned up to is in the covariances.
  const Vector6d extra = (with.state().pose_covariance - without.state().pose_covariance).diagonal();
  EXPECT_NEAR(extra[5], 240.0 * 1e-4, 0.2 * 240.0 * 1e-4);
  EXPECT_GT(extra[0] + extra[1], 2.0 * 240.0 * 0.01);
}

/// The largest relative fall of the rotation's variance about any axis from one frame to the next.
class RotationWatch {
 public:
  void add(const Estimator& estimator) {
    const Eigen::Vector3d variance = estimator.state().pose_covariance.diagonal().tail<3>();
    for (int i = 0; i < 3; ++i) largest_ = std::max(largest_, last_[i] - variance[i]);
    last_ = variance;
  }
  double largestFall() const { return largest_; } ///< rad^2
  const Eigen::Vector3d& last() const { return last_; }

 private:
  Eigen::Vector3d last_ = Eigen::Vector3d::Zero();
  double largest_ = 0.0;
};

TEST(InvariantEstimator, IsNeverSurerOfHowTheWorldIsTurnedThanItWas) {
  for (const double density : {0.0, 0.0015}) {
    InvariantConfig config;
    config.drift_rotation = density;
    Road road(3, 30, kTypical);
    InvariantEstimator estimator = makeEstimator(config);
    RotationWatch watch;
    const Vector6d cruising = road.twist();
    for (int i = 0; i < 1500; ++i) {
      if (i == 500) road.setTwist(Vector6d::Zero()); // a stop
      if (i == 600) road.setTwist(cruising);
      if (i == 800) {
        road.setTwist(cruising + 0.4 * Vector6d::Unit(4)); // a bump
      }
      if (i == 802) road.setTwist(cruising);
      road.feed(estimator);
      watch.add(estimator);
    }
    EXPECT_EQ(watch.largestFall(), 0.0) << density;
    EXPECT_GT(watch.last().minCoeff(), 1e-6) << density;
  }
}

} // namespace
} // namespace vi_ekf_slam::invariant

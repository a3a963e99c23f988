// Somebody says where the vehicle is.

#include <algorithm>
#include <memory>

#include "../road.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

const Matrix6d kTold = (Vector6d() << 0.04, 0.04, 0.01, 1e-3, 1e-3, 4e-3).finished().asDiagonal();

/// The drive goes on from where the vehicle was said to be, as well as the odometry and the features have it.
void expectToGoOn(InvariantEstimator& estimator, Road& road, const SE3& told_T_pose) {
  for (int i = 0; i < 20; ++i) road.feed(estimator);
  const SE3 expected = told_T_pose * road.truth();
  const StateEstimate state = estimator.state();
  EXPECT_LT((state.world_T_imu.translation() - expected.translation()).norm(), 0.5);
  EXPECT_LT(so3::Log(state.world_T_imu.rotation().transpose() * expected.rotation()).norm(), 0.03);
  EXPECT_TRUE(isPositive(state.pose_covariance, 1e-13));
}

TEST(ToldPose, IsWhereTheEstimateGoesOn) {
  Road road(3, 40, kTypical);
  InvariantEstimator estimator = driven(road, 60);
  const Vector6d twist = estimator.state().twist;
  const auto map = estimator.exactMap()().landmarks;
  const SE3 somewhere = SE3::Exp((Vector6d() << 200.0, -50.0, 3.0, 0.0, 0.0, 2.0).finished());
  const SE3 told = somewhere * road.truth();
  ASSERT_TRUE(estimator.setPose(told, kTold));
  const StateEstimate state = estimator.state();
  EXPECT_LT(distance(state.world_T_imu.matrix(), told.matrix()), 1e-9);
  EXPECT_LT(relativeDistance(state.pose_covariance, kTold), 1e-3);
  EXPECT_LT(distance(state.twist, twist), 1e-6) << "nothing was said of the twist";
  const auto still = estimator.exactMap()().landmarks;
  EXPECT_GT(still.size(), map.size() * 9 / 10); // not the tracks that have just begun
  for (const LandmarkEstimate& l : still) {
    const auto same = [&l](const LandmarkEstimate& other) { return other.id == l.id; };
    const auto before = std::find_if(map.begin(), map.end(), same);
    ASSERT_NE(map.end(), before);
    EXPECT_LT((before->position - l.position).norm(), 1e-3) << "landmarks stay where they are";
  }
  expectToGoOn(estimator, road, somewhere);
}

TEST(ToldPose, BeforeTheFirstMeasurementIsWhereTheDriveBegins) {
  Road road(4, 40, kTypical);
  InvariantEstimator estimator = withRig();
  const SE3 start = SE3::Exp((Vector6d() << 5.0, 6.0, 7.0, 0.1, 0.2, 0.3).finished());
  ASSERT_TRUE(estimator.setPose(start, kTold));
  expectToGoOn(estimator, road, start);
}

TEST(ToldPose, InALoadedMapIsThePlaceThere) {
  Road road(5, 40, kTypical);
  InvariantEstimator first = driven(road, 60);
  const auto map = std::make_shared<const SavedMap>(first.savedMap()());
  InvariantEstimator second = withRig();
  second.relocaliseIn(map);
  const SE3 begin = road.pose();
  road.feedSamples(second); // in a frame of its own, which begins here
  road.move();
  EXPECT_EQ(MapUse::kWaiting, second.mapUse());
  const SE3 told = begin * second.state().world_T_imu;
  ASSERT_TRUE(second.setPose(told, kTold));
  EXPECT_EQ(MapUse::kRelocalised, second.mapUse());
  EXPECT_LT(distance(second.state().world_T_imu.matrix(), told.matrix()), 1e-9);
  EXPECT_LT(relativeDistance(second.state().pose_covariance, kTold), 1e-3);
  EXPECT_GE(second.exactMap()().landmarks.size(), map->landmarks.size());
  expectToGoOn(second, road, SE3());
}

TEST(ToldPose, IsNotTakenWithACovarianceThatIsNone) {
  Road road(6, 40, kTypical);
  InvariantEstimator estimator = driven(road, 20);
  const StateEstimate before = estimator.state();
  EXPECT_FALSE(estimator.setPose(SE3(), -1e9 * Matrix6d::Identity()));
  expectSame(before, estimator.state(), 0.0);
}

} // namespace
} // namespace vi_ekf_slam

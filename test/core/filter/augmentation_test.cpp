// New variables, and those that go.

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(Augmentation, AddsALinearFunctionOfWhatIsThereAndNoise) {
  Random random(6);
  Scene scene = busyScene(random, 2);
  const Eigen::MatrixXd P = scene.filter.covariance();
  const Eigen::MatrixXd J = randomMatrix(random, 3, 5), noise = random.covariance<3>();
  const Eigen::Index from = 4;
  const Handle added =
      scene.filter.augment(Chart::kPoint, Eigen::Vector3d(1.0, 2.0, 3.0), noise, LinearFunction{from, J});
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(P.rows() + 3, P.cols());
  A.topRows(P.rows()).setIdentity();
  A.bottomRows<3>().middleCols(from, 5) = J;
  Eigen::MatrixXd expected = A * P * A.transpose();
  expected.bottomRightCorner<3, 3>() += noise;
  EXPECT_LT(distance(scene.filter.covariance(), expected), 1e-13);
  EXPECT_EQ(scene.filter.variables().point(added), Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(scene.filter.rowOf(added), P.rows());
}

TEST(Augmentation, NoiseIsAddedToTheseRowsAlone) {
  Random random(16);
  Scene scene = busyScene(random, 2);
  Eigen::MatrixXd expected = scene.filter.covariance();
  const Eigen::Index row = scene.filter.rowOf(scene.points[1]);
  const Eigen::Matrix3d noise = random.covariance<3>();
  expected.block<3, 3>(row, row) += noise;
  scene.filter.addNoise(row, noise);
  EXPECT_EQ(distance(scene.filter.covariance(), expected), 0.0);
}

TEST(Augmentation, RemovingAVariableLeavesTheMarginal) {
  Random random(7);
  for (std::size_t gone = 0; gone < 5; ++gone) {
    Scene scene = busyScene(random, 4);
    // One of another size among them: then those behind move up.
    scene.filter.augment(Chart::kVector, Eigen::Vector2d(1.0, 2.0), randomCovariance(random, 2, 1.0),
                         {0, randomMatrix(random, 2, scene.filter.rows())});
    scene.addPoint(random);
    const Filter before = scene.filter;
    const auto handles = before.variables().handles();
    const Handle removed = handles[handles.size() - 1 - gone];
    scene.filter.remove(removed);
    EXPECT_FALSE(scene.filter.variables().contains(removed));
    ASSERT_EQ(scene.filter.rows() + before.variables().sizeOf(removed), before.rows());
    for (const Handle a : handles) {
      if (a == removed) continue;
      if (before.variables().chartOf(a) != Chart::kPose) {
        EXPECT_EQ(distance(scene.filter.variables().mean(a), before.variables().mean(a)), 0.0);
      }
      for (const Handle b : handles) {
        if (b == removed) continue;
        EXPECT_EQ(distance(scene.filter.covariance(a, b), before.covariance(a, b)), 0.0);
      }
    }
  }
}

TEST(Augmentation, GrowsBeyondItsFirstCapacityAndKeepsWhatItKnows) {
  Random random(8);
  Scene scene = busyScene(random, 1);
  const Eigen::MatrixXd P = scene.filter.covariance();
  std::vector<Handle> added;
  for (int i = 0; i < 400; ++i)
    added.push_back(scene.filter.augment(Chart::kPoint, Eigen::Vector3d::Constant(i),
                                         Eigen::Matrix3d::Identity(), {0, Eigen::Matrix3d::Identity()}));
  ASSERT_EQ(scene.filter.rows(), P.rows() + 3 * 400);
  EXPECT_EQ(distance(scene.filter.covariance().topLeftCorner(P.rows(), P.cols()), P), 0.0);
  const Eigen::MatrixXd grown = scene.filter.covariance();
  EXPECT_TRUE(grown.allFinite());
  EXPECT_LT(distance(grown, grown.transpose()), 1e-15);
  for (int i = 0; i < 400; ++i)
    EXPECT_EQ(scene.filter.variables().point(added[static_cast<std::size_t>(i)]),
              Eigen::Vector3d::Constant(i));
  for (const Handle handle : added) scene.filter.remove(handle);
  EXPECT_EQ(distance(scene.filter.covariance(), P), 0.0);
}

} // namespace
} // namespace vi_ekf_slam::test

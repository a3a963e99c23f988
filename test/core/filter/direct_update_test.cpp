#include "vi_ekf_slam/core/filter/direct_update.hpp"

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

const Eigen::Matrix3d kPixelNoise = Eigen::Vector3d(1.3, 0.65, 1.3).asDiagonal();

LinearMeasurement direct(Random& random, const Scene& scene, std::size_t point) {
  const Eigen::Matrix3d J = 100.0 * (Eigen::Matrix3d::Identity() + 0.3 * randomMatrix(random, 3, 3));
  LinearMeasurement z(random.vector<3>(-1.0, 1.0), kPixelNoise);
  return z.by(scene.filter.rowOf(scene.points[point]), J);
}

std::vector<LinearMeasurement> directs(Random& random, const Scene& scene,
                                       const std::vector<std::size_t>& seen) {
  std::vector<LinearMeasurement> all;
  for (const std::size_t i : seen) {
    all.push_back(direct(random, scene, i));
    // Some know the scale too.
    if (scene.scale && i % 2 == 0)
      all.back().by(scene.filter.rowOf(*scene.scale), 50.0 * randomMatrix(random, 3, 1));
  }
  return all;
}

TEST(DirectUpdateTest, IsTheKalmanUpdateWhateverTheOrderAndWhoeverIsNotSeen) {
  Random random(1);
  const std::vector<std::vector<std::size_t>> orders = {
      {0, 1, 2, 3, 4, 5, 6, 7, 8, 9}, {7, 0, 3, 1, 6, 2, 4, 9, 5}, {9, 2, 8, 5, 0, 1, 3, 4, 6}};
  for (const double scale_sigma : {0.0, 0.02}) {
    for (const auto& seen : orders) {
      const Scene scene = busyScene(random, 10, scale_sigma);
      const auto all = directs(random, scene, seen);
      const Eigen::MatrixXd P = scene.filter.covariance();
      Innovation in(P, all);
      ASSERT_TRUE(in.factorise());
      const auto update = DirectUpdate::make(in);
      ASSERT_TRUE(update);
      EXPECT_TRUE(update->isFinite());
      const DenseMeasurement z = denseOf(all, P.rows());
      const Eigen::MatrixXd S = z.H * P * z.H.transpose() + z.R;
      const Eigen::MatrixXd K = P * z.H.transpose() * inverseOf(S);
      EXPECT_LT(relativeDistance(update->inverseS(), inverseOf(S)), 1e-9);

      Eigen::MatrixXd still = P;
      update->correct(still, {});
      const Eigen::MatrixXd expected = P - K * S * K.transpose();
      EXPECT_LT(worstCorrelationError(still, expected), 1e-9);
      EXPECT_LE(distance(still, still.transpose()), 1e-15);

      std::vector<Variables::Reexpressed> points;
      Eigen::MatrixXd T = Eigen::MatrixXd::Identity(P.rows(), P.cols());
      for (const Handle point : scene.points) {
        const Eigen::Matrix3d M = Eigen::Matrix3d::Identity() + 0.1 * randomMatrix(random, 3, 3);
        points.push_back({scene.filter.rowOf(point), M});
        T.block<3, 3>(points.back().row, points.back().row) = M;
        if (!scene.scale) continue;
        points.back().N = {scene.filter.rowOf(*scene.scale), randomMatrix(random, 3, 1)};
        T.block<3, 1>(points.back().row, points.back().N.row) = points.back().N.J;
      }
      Eigen::MatrixXd moved = P;
      update->correct(moved, points);
      EXPECT_LT(worstCorrelationError(moved, T * expected * T.transpose()), 1e-9);
      EXPECT_LE(distance(moved, moved.transpose()), 1e-15);

      const Eigen::MatrixXd before = randomMatrix(random, P.rows(), 7), HX = z.H * before;
      Eigen::MatrixXd applied(HX.rows(), HX.cols());
      in.applyH(before, applied);
      EXPECT_LT(relativeDistance(applied, HX), 1e-14);
      Eigen::MatrixXd rows = before;
      update->correctRows(rows, HX, inverseOf(S) * HX, points);
      EXPECT_LT(relativeDistance(rows, T * (before - K * HX)), 1e-9);
      Eigen::MatrixXd apart = expected;
      reexpress(apart, points);
      EXPECT_LT(worstCorrelationError(apart, T * expected * T.transpose()), 1e-11);
    }
  }
}

TEST(DirectUpdateTest, IsForMostPointsSeenOnceEachAndDirectly) {
  Random random(2);
  const Scene scene = busyScene(random, 10, 0.02);
  const auto isMade = [&](const std::vector<LinearMeasurement>& all) {
    Innovation in(scene.filter.covariance(), all);
    return in.factorise() && DirectUpdate::make(in).has_value();
  };
  const auto most = directs(random, scene, {0, 1, 2, 3, 4, 5, 6, 7, 8});
  const auto with = [&most](const LinearMeasurement& z) {
    auto all = most;
    all.push_back(z);
    return all;
  };
  EXPECT_TRUE(isMade(most));
  EXPECT_TRUE(isMade(with(direct(random, scene, 9))));
  EXPECT_FALSE(isMade(directs(random, scene, {0, 1, 2}))) << "few";
  EXPECT_FALSE(isMade(with(direct(random, scene, 7)))) << "one twice";
  const Eigen::Index row = scene.filter.rowOf(scene.points[9]);
  EXPECT_FALSE(isMade(with(LinearMeasurement(Eigen::Vector3d::Zero(), kPixelNoise)
                               .by(row, Eigen::Matrix3d(Eigen::Vector3d(100.0, 100.0, 1e-7).asDiagonal())))))
      << "a depth that is not seen";
  EXPECT_FALSE(isMade(with(LinearMeasurement(Eigen::Vector2d::Zero(), Eigen::Matrix2d::Identity())
                               .by(row, randomMatrix(random, 2, 3)))))
      << "not three rows";
  EXPECT_FALSE(isMade(with(LinearMeasurement(Eigen::Vector3d::Zero(), kPixelNoise)
                               .by(row, Eigen::Matrix3d::Identity())
                               .by(scene.filter.rowOf(scene.points[0]), -Eigen::Matrix3d::Identity()))))
      << "one point from another";
  LinearMeasurement sharp(Eigen::Vector3d::Zero(), Eigen::Matrix3d(1e-9 * Eigen::Matrix3d::Identity()));
  EXPECT_FALSE(isMade(with(sharp.by(row, Eigen::Matrix3d::Identity())))) << "S far larger than R";
}

TEST(DirectUpdateTest, LosesNothingWhereThePointsAreKnownFarBetterThanMeasured) {
  Random random(3);
  Scene fast = busyScene(random, 9);
  fast.filter.deactivate(fast.points[8]);
  Scene slow = fast;
  auto all = directs(random, fast, {0, 1, 2, 3, 4, 5, 6, 7});
  std::size_t made = 0;
  for (int i = 0; i < 3000; ++i) {
    for (Scene* scene : {&fast, &slow}) {
      scene->motion.propagate(scene->filter, 0.1);
      scene->filter.settle();
      std::vector<LinearMeasurement> still;
      for (const LinearMeasurement& z : all) {
        still.emplace_back(Eigen::Vector3d::Zero(), z.noise());
        // The same Jacobians in another term's place: then the general form has to do.
        if (scene == &slow) still.back().by(0, Eigen::Matrix3d::Zero());
        still.back().by(z.term(0).column, z.term(0).H);
      }
      Innovation in(scene->filter.covariance(), still);
      ASSERT_TRUE(in.factorise());
      const bool is_direct = DirectUpdate::make(in).has_value();
      made += is_direct ? 1 : 0;
      ASSERT_FALSE(scene == &slow && is_direct);
      ASSERT_TRUE(scene->filter.correct(in));
    }
  }
  EXPECT_GT(made, 2900u);
  expectCovariance(jointOf(fast.filter));
  EXPECT_LT(worstCorrelationError(jointOf(fast.filter), jointOf(slow.filter)), 1e-8);
}

} // namespace
} // namespace vi_ekf_slam::test

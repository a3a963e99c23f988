#include "vi_ekf_slam/core/map/archive.hpp"

#include <gtest/gtest.h>

#include "../covariances.hpp"
#include "../numeric.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/map/points.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(ArchiveTest, HasTheLastEstimateOfEachAndForgetsThoseThatCameFirst) {
  Archive archive(3);
  for (FeatureId id = 1; id <= 3; ++id)
    archive.put({id, Eigen::Vector3d::Constant(static_cast<double>(id)), isotropic(1.0)});
  archive.put({1, Eigen::Vector3d::Constant(7.0), isotropic(2.0)});
  ASSERT_EQ(archive.landmarks().size(), 3u);
  EXPECT_EQ(archive.landmarks().at(1).position[0], 7.0);
  archive.put({4, Eigen::Vector3d::Zero(), isotropic(1.0)});
  EXPECT_EQ(archive.landmarks().size(), 3u);
  EXPECT_EQ(archive.landmarks().count(1), 0u);
  EXPECT_EQ(archive.landmarks().count(4), 1u);
}

TEST(ArchiveTest, MovedIsNoSurerThanAnyCorrelationMayHaveIt) {
  Random random(1);
  const SE3 T = SE3::Exp((Vector6d() << 30.0, -20.0, 5.0, 0.4, -0.3, 1.9).finished());
  Archive archive(10);
  const LandmarkEstimate before{1, {3.0, 4.0, 5.0}, random.covariance<3>()};
  archive.put(before);
  const Eigen::Vector3d about = T * Eigen::Vector3d(1.0, 1.0, 1.0);
  const Matrix6d alignment = 0.1 * random.covariance<6>();
  archive.move(T, about, alignment);
  const LandmarkEstimate& after = archive.landmarks().at(1);
  EXPECT_LT(distance(after.position, T * before.position), 1e-12);
  Eigen::Matrix<double, 3, 6> J;
  J << Eigen::Matrix3d::Identity(), -so3::hat(after.position - about);
  const Eigen::Matrix3d own = T.rotation() * before.covariance * T.rotation().transpose();
  const Eigen::Matrix3d moved = J * alignment * J.transpose();
  // The two errors the same one but for a factor: the worst case.
  for (const double factor : {0.3, 1.0, 3.0}) {
    const Eigen::Matrix3d bound = (1.0 + factor) * own + (1.0 + 1.0 / factor) * moved;
    EXPECT_TRUE(isPositive(bound - 0.5 * after.covariance, 1e-12)) << factor;
  }
  EXPECT_TRUE(isPositive(after.covariance - own - moved, 1e-12));
}

TEST(PointGridTest, FindsTheNearestAsAllOfThemAreLookedAt) {
  Random random(2);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 300; ++i) points.push_back(random.vector<3>(-10.0, 10.0));
  const PointGrid grid(points, 1.5);
  EXPECT_EQ(grid.size(), points.size());
  for (int run = 0; run < 300; ++run) {
    const Eigen::Vector3d where = random.vector<3>(-11.0, 11.0);
    const double tolerance = random.uniform(0.2, 1.5);
    std::optional<std::size_t> nearest;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double d = (points[i] - where).norm();
      if (d < tolerance && (!nearest || d < (points[*nearest] - where).norm())) nearest = i;
    }
    const auto found = grid.nearest(where, tolerance);
    ASSERT_EQ(found.has_value(), nearest.has_value());
    if (!found) continue;
    EXPECT_EQ(found->first, *nearest);
    EXPECT_EQ(found->second, (points[*nearest] - where).norm());
  }
}

} // namespace
} // namespace vi_ekf_slam::test

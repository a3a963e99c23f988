#include "vi_ekf_slam/core/geometry/rigid_consensus.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "../numeric.hpp"

namespace vi_ekf_slam::test {
namespace {

const SE3 kCommonMotion = SE3::Exp((Vector6d() << 18.0, -3.0, 0.5, 0.02, -0.03, 0.4).finished());

/// Points up to 60 m away, known worse the farther they are, all displaced by kCommonMotion but for the first
/// `wrong`.
std::vector<Displaced> displaced(Random& random, std::size_t count, std::size_t wrong) {
  std::vector<Displaced> points;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d seen(random.uniform(5.0, 60.0), random.uniform(-20.0, 20.0),
                               random.uniform(-2.0, 5.0));
    const double sigma = 0.001 * seen.squaredNorm();
    const Eigen::Matrix3d covariance = Eigen::Vector3d(sigma * sigma, 0.01, 0.01).asDiagonal();
    const Eigen::Vector3d noise(sigma * random.uniform(-1.5, 1.5), 0.1 * random.uniform(-1.5, 1.5),
                                0.1 * random.uniform(-1.5, 1.5));
    const Eigen::Vector3d elsewhere(random.uniform(-60.0, 60.0), random.uniform(-60.0, 60.0), 0.0);
    points.push_back(
        {i < wrong ? elsewhere : Eigen::Vector3d(kCommonMotion * seen + noise), seen, covariance});
  }
  return points;
}

TEST(RigidConsensus, IsFoundAmongPointsThatAreNotPartOfIt) {
  Random random(1);
  for (int run = 0; run < 50; ++run) {
    const auto motion = commonMotion(displaced(random, 20, 6));
    ASSERT_TRUE(motion) << run;
    const Vector6d error = (motion->inverse() * kCommonMotion).Log();
    EXPECT_LT(error.head<3>().norm(), 0.7) << run;
    EXPECT_LT(error.tail<3>().norm(), 0.05) << run;
  }
}

TEST(RigidConsensus, NeedsThatMostPointsAgree) {
  Random random(2);
  for (int run = 0; run < 50; ++run) EXPECT_FALSE(commonMotion(displaced(random, 20, 9))) << run;
}

TEST(RigidConsensus, NeedsFivePoints) {
  Random random(3);
  EXPECT_TRUE(commonMotion(displaced(random, 5, 0)));
  EXPECT_FALSE(commonMotion(displaced(random, 4, 0)));
  EXPECT_FALSE(commonMotion({}));
}

// A front end that mixes up the few tracks that it has left.
TEST(RigidConsensus, IsNotFoundAmongFewPointsThatAreNoneOfIt) {
  Random random(5);
  for (const std::size_t count : {5u, 6u, 7u, 8u, 10u}) {
    int found = 0;
    for (int run = 0; run < 1000; ++run) found += commonMotion(displaced(random, count, count)) ? 1 : 0;
    EXPECT_LE(found, 2) << count;
  }
}

TEST(RigidConsensus, IsNotFoundInNumbersThatAreNone) {
  Random random(4);
  std::vector<Displaced> points = displaced(random, 10, 0);
  for (Displaced& point : points) point.seen.x() = std::nan("");
  EXPECT_FALSE(commonMotion(points));
}

} // namespace
} // namespace vi_ekf_slam::test

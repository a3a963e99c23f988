#include "vi_ekf_slam/core/geometry/gaussian.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "../covariances.hpp"
#include "../numeric.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(Gaussian, SolvesAsTheInverseDoes) {
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Matrix3d S = random.covariance<3>(), B = random.covariance<3>();
    const Eigen::Vector3d b = random.vector<3>(-1.0, 1.0);
    EXPECT_LT(distance(S * solvePositive(S, b), b), 1e-12);
    EXPECT_LT(distance(S * solvePositive(S, B), B), 1e-12);
    const Matrix6d S6 = random.covariance<6>();
    const Vector6d b6 = random.vector<6>(-1.0, 1.0);
    EXPECT_LT(distance(S6 * solvePositive(S6, b6), b6), 1e-11);
    EXPECT_NEAR(squaredMahalanobis(b, S), b.dot(inverseOf(S) * b), 1e-10);
    EXPECT_NEAR(squaredMahalanobis(b6, S6), b6.dot(inverseOf(S6) * b6), 1e-10);
    EXPECT_TRUE(isPositiveDefinite(S));
  }
}

TEST(Gaussian, NoGateTakesWhatHasNoCovariance) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Vector3d e(0.1, 0.2, 0.3);
  for (const Eigen::Vector3d& variances :
       {Eigen::Vector3d(1.0, -1e-9, 1.0), Eigen::Vector3d(1.0, 1.0, 0.0), Eigen::Vector3d(nan, 1.0, 1.0)}) {
    const Eigen::Matrix3d S = variances.asDiagonal();
    EXPECT_FALSE(isPositiveDefinite(S));
    EXPECT_FALSE(squaredMahalanobis(e, S) < 1e300);
    EXPECT_TRUE(std::isnan(solvePositive(S, e)[0]));
    Matrix6d S6 = Matrix6d::Identity();
    S6.topLeftCorner<3, 3>() = S;
    EXPECT_FALSE(squaredMahalanobis(Vector6d::Ones(), S6) < 1e300);
  }
}

} // namespace
} // namespace vi_ekf_slam

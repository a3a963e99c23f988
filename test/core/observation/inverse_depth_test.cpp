#include "vi_ekf_slam/core/observation/inverse_depth.hpp"

#include <gtest/gtest.h>

#include "../numeric.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(InverseDepth, JacobiansAreEachOthersInverseAndTheDerivatives) {
  Random random(17);
  for (int run = 0; run < 100; ++run) {
    const Eigen::Vector3d q(random.uniform(-10.0, 10.0), random.uniform(-5.0, 5.0),
                            random.uniform(0.5, 80.0));
    const Eigen::Matrix3d product = InverseDepth::jacobian(q) * InverseDepth::pointJacobian(q);
    EXPECT_LT(distance(product, Eigen::Matrix3d::Identity()), 1e-12);
    const auto coordinates = [](const Eigen::Vector3d& p) {
      return Eigen::Vector3d(p.x() / p.z(), p.y() / p.z(), 1.0 / p.z());
    };
    const Eigen::Matrix3d numeric = numericJacobian<3, 3>(coordinates, q);
    EXPECT_LT(relativeDistance(InverseDepth::jacobian(q), numeric), 1e-8);
    const auto point = [](const Eigen::Vector3d& l) {
      return Eigen::Vector3d(l.x() / l.z(), l.y() / l.z(), 1.0 / l.z());
    };
    const Eigen::Matrix3d back = numericJacobian<3, 3>(point, coordinates(q), 1e-3 / q.z());
    EXPECT_LT(relativeDistance(InverseDepth::pointJacobian(q), back), 1e-8);
  }
}

TEST(InverseDepth, MovesThePointInItsOwnCoordinates) {
  const Eigen::Vector3d q(2.0, -1.0, 20.0);
  EXPECT_LT(distance(InverseDepth::moved(q, Eigen::Vector3d::Zero()), q), 1e-13);
  const Eigen::Vector3d little(1e-4, -2e-4, 1e-3);
  EXPECT_LT(distance(InverseDepth::moved(q, little), q + little), 1e-6);
  // 20 m further, by the derivative nothing is left of the inverse depth: it is held at a fifth.
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, 20.0}).z(), 100.0, 1e-9);
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, 10.0}).z(), 40.0, 1e-9);
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, -20.0}).z(), 10.0, 1e-9);
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, 1e6}).z(), 100.0, 1e-9);
  EXPECT_GT(InverseDepth::moved(q, {0.0, 0.0, -1e6}).z(), 0.0);
  EXPECT_TRUE(InverseDepth::isDefined({0.0, 0.0, 0.31}));
  EXPECT_FALSE(InverseDepth::isDefined({0.0, 0.0, 0.29}));
  EXPECT_FALSE(InverseDepth::isDefined({0.0, 0.0, -1.0}));
}

// Points that were made active because they should come into view go past the camera unseen. Half a metre of
// a correction would move such a one from 30 m on its right to 37 m on its left, and its variance likewise.
TEST(InverseDepth, IsNotDefinedWhereNoCameraLooks) {
  const Eigen::Vector3d beside(30.0, 0.0, 0.4), correction(0.0, 0.0, 0.5);
  EXPECT_GT((InverseDepth::moved(beside, correction) - beside).norm(), 60.0);
  EXPECT_FALSE(InverseDepth::isDefined(beside));
  EXPECT_FALSE(InverseDepth::isDefined({0.0, -30.0, 5.0}));
  EXPECT_TRUE(InverseDepth::isDefined({4.0, 4.0, 1.0}));
}

} // namespace
} // namespace vi_ekf_slam::test

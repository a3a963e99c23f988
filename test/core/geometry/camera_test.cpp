#include "vi_ekf_slam/core/geometry/camera.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "../numeric.hpp"

namespace vi_ekf_slam {
namespace {

using test::distance;
using test::numericJacobian;
using test::Random;
using test::relativeDistance;

const StereoCamera kCamera{718.0, 552.0, 607.0, 185.0, 0.54};

Eigen::Vector3d pointInFront(Random& random) {
  return {random.uniform(-10.0, 10.0), random.uniform(-5.0, 5.0), random.uniform(2.0, 60.0)};
}

TEST(StereoCamera, ProjectIsTheCalibrationMatrixOfEquation4) {
  Eigen::Matrix4d M;
  M << 718.0, 0.0, 607.0, 0.0, 0.0, 552.0, 185.0, 0.0, 718.0, 0.0, 607.0, -718.0 * 0.54, 0.0, 552.0, 185.0,
      0.0;
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = pointInFront(random);
    const Eigen::Vector4d z = M * p.homogeneous() / p.z();
    EXPECT_LT(distance(kCamera.project(p), z), 1e-11);
  }
}

TEST(StereoCamera, RightImageSeesAPointFartherLeft) {
  const StereoPixels z = kCamera.project({1.0, -2.0, 10.0});
  EXPECT_LT(z[2], z[0]);
  EXPECT_NEAR(z[0] - z[2], 718.0 * 0.54 / 10.0, 1e-12);
  EXPECT_EQ(z[1], z[3]);
}

TEST(StereoCamera, ProjectJacobianIsTheNumericDerivative) {
  Random random(2);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = pointInFront(random);
    const auto numeric =
        numericJacobian<4, 3>([](const Eigen::Vector3d& x) { return kCamera.project(x); }, p, 1e-3);
    EXPECT_LT(relativeDistance(kCamera.projectJacobian(p), numeric), 1e-8);
  }
}

TEST(StereoCamera, TriangulateUndoesProject) {
  Random random(3);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = pointInFront(random);
    const auto back = kCamera.triangulate(kCamera.project(p));
    ASSERT_TRUE(back);
    EXPECT_LT(relativeDistance(*back, p), 1e-11);
  }
}

TEST(StereoCamera, TriangulateAveragesTheTwoRows) {
  const Eigen::Vector3d p(1.0, -2.0, 10.0);
  StereoPixels z = kCamera.project(p);
  z[1] += 3.0;
  z[3] -= 3.0;
  const auto back = kCamera.triangulate(z);
  ASSERT_TRUE(back);
  EXPECT_LT(distance(*back, p), 1e-12);
}

TEST(StereoCamera, TriangulateJacobianIsTheNumericDerivative) {
  Random random(4);
  for (int i = 0; i < 100; ++i) {
    StereoPixels z = kCamera.project(pointInFront(random));
    z += random.vector<4>(-1.0, 1.0);
    const auto numeric =
        numericJacobian<3, 4>([](const StereoPixels& x) { return kCamera.triangulate(x).value(); }, z, 1e-2);
    EXPECT_LT(relativeDistance(kCamera.triangulateJacobian(z), numeric), 1e-7);
  }
}

TEST(StereoCamera, JacobiansOfProjectAndTriangulateAreInverse) {
  Random random(5);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = pointInFront(random);
    const Eigen::Matrix3d product =
        kCamera.triangulateJacobian(kCamera.project(p)) * kCamera.projectJacobian(p);
    EXPECT_LT(distance(product, Eigen::Matrix3d::Identity()), 1e-10);
  }
}

TEST(StereoCamera, TriangulateRefusesDisparitiesThatAreNotPositive) {
  EXPECT_FALSE(kCamera.triangulate({600.0, 180.0, 600.0, 180.0}));
  EXPECT_FALSE(kCamera.triangulate({600.0, 180.0, 601.0, 180.0}));
  EXPECT_FALSE(kCamera.triangulate({-1.0, -1.0, -1.0, -1.0})); // the data set's mark of "not seen"
  EXPECT_TRUE(kCamera.triangulate({600.0, 180.0, 599.0, 180.0}));
}

TEST(StereoCamera, TriangulateRefusesPixelsThatAreNotFinite) {
  const StereoPixels good(600.0, 180.0, 580.0, 180.0);
  ASSERT_TRUE(kCamera.triangulate(good));
  for (const double bad :
       {std::nan(""), std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < 4; ++i) {
      StereoPixels z = good;
      z[i] = bad;
      EXPECT_FALSE(kCamera.triangulate(z)) << bad << " at " << i;
    }
  }
}

TEST(StereoCamera, TriangulateNeverReturnsAPointThatIsNotFinite) {
  EXPECT_FALSE(kCamera.triangulate({5e-324, 1e300, 0.0, 1e300}));
}

TEST(StereoCamera, IsValidAsksForFiniteValuesAndPositiveLengths) {
  ASSERT_TRUE(kCamera.isValid());
  for (double StereoCamera::*value : {&StereoCamera::fu, &StereoCamera::fv, &StereoCamera::cu,
                                      &StereoCamera::cv, &StereoCamera::baseline}) {
    for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
      StereoCamera camera = kCamera;
      camera.*value = bad;
      EXPECT_FALSE(camera.isValid());
    }
  }
  for (double StereoCamera::*value : {&StereoCamera::fu, &StereoCamera::fv, &StereoCamera::baseline}) {
    for (const double bad : {0.0, -1.0}) {
      StereoCamera camera = kCamera;
      camera.*value = bad;
      EXPECT_FALSE(camera.isValid());
    }
  }
  EXPECT_FALSE(StereoCamera().isValid());
}

} // namespace
} // namespace vi_ekf_slam

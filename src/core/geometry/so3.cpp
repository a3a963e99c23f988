#include "vi_ekf_slam/core/geometry/so3.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace vi_ekf_slam::so3 {
namespace {

// Below these angles the closed forms lose digits to cancellation and the series are exact to double
// precision.
constexpr double kSmallAngle = 1e-2, kSmallSecond = 0.1;

/// (sin t / t, (1 - cos t) / t^2, (t - sin t) / t^3)
struct Coefficients {
  double a, b, c;
};

Coefficients coefficients(double theta2) {
  const double theta = std::sqrt(theta2);
  if (theta < kSmallAngle) {
    const double t4 = theta2 * theta2;
    return {1.0 - theta2 / 6.0 + t4 / 120.0, 0.5 - theta2 / 24.0 + t4 / 720.0,
            1.0 / 6.0 - theta2 / 120.0 + t4 / 5040.0};
  }
  const double s = std::sin(theta);
  const double half = std::sin(0.5 * theta);
  return {s / theta, 2.0 * half * half / theta2, (theta - s) / (theta2 * theta)};
}

} // namespace

Eigen::Matrix3d hat(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Eigen::Matrix3d Exp(const Eigen::Vector3d& phi) {
  const Coefficients k = coefficients(phi.squaredNorm());
  const Eigen::Matrix3d W = hat(phi);
  return Eigen::Matrix3d::Identity() + k.a * W + k.b * W * W;
}

Eigen::Vector3d Log(const Eigen::Matrix3d& R) {
  // Through the quaternion: its vector part is well conditioned at pi, where the matrix logarithm is not.
  const Eigen::Quaterniond q(R);
  const Eigen::Vector3d v = q.w() < 0.0 ? Eigen::Vector3d(-q.vec()) : Eigen::Vector3d(q.vec());
  const double w = std::abs(q.w()), n = v.norm();
  if (n < 1e-10) return 2.0 / w * v;
  return 2.0 * std::atan2(n, w) / n * v;
}

Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& phi) {
  const Coefficients k = coefficients(phi.squaredNorm());
  const Eigen::Matrix3d W = hat(phi);
  return Eigen::Matrix3d::Identity() + k.b * W + k.c * W * W;
}

Eigen::Matrix3d secondIntegral(const Eigen::Vector3d& phi) {
  const double theta2 = phi.squaredNorm();
  const Coefficients k = coefficients(theta2);
  const double t4 = theta2 * theta2;
  const double d = theta2 < kSmallSecond * kSmallSecond
                       ? 1.0 / 24.0 - theta2 / 720.0 + t4 / 40320.0 - t4 * theta2 / 3628800.0
                       : (0.5 - k.b) / theta2;
  const Eigen::Matrix3d W = hat(phi);
  return 0.5 * Eigen::Matrix3d::Identity() + k.c * W + d * W * W;
}

Eigen::Matrix3d leftJacobianInverse(const Eigen::Vector3d& phi) {
  const double theta2 = phi.squaredNorm(), theta = std::sqrt(theta2);
  const double d = theta < kSmallAngle ? 1.0 / 12.0 + theta2 / 720.0 + theta2 * theta2 / 30240.0
                                       : 1.0 / theta2 - 0.5 / (theta * std::tan(0.5 * theta));
  const Eigen::Matrix3d W = hat(phi);
  return Eigen::Matrix3d::Identity() - 0.5 * W + d * W * W;
}

/// By the quaternion: the turn of q about z alone that is nearest to it.
double heading(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q(R);
  return 2.0 * std::atan2(q.z(), q.w());
}

Eigen::Matrix3d normalized(const Eigen::Matrix3d& R) {
  return Eigen::Quaterniond(R).normalized().toRotationMatrix();
}

bool isRotation(const Eigen::Matrix3d& R, double tolerance) {
  const Eigen::Matrix3d error = R.transpose() * R - Eigen::Matrix3d::Identity();
  return R.allFinite() && error.cwiseAbs().maxCoeff() <= tolerance && R.determinant() > 0.0;
}

} // namespace vi_ekf_slam::so3

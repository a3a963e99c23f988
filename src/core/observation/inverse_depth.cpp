#include "vi_ekf_slam/core/observation/inverse_depth.hpp"

#include <algorithm>

namespace vi_ekf_slam {
namespace {

constexpr double kMinDepth = 0.3;    // m
constexpr double kWidest = 5.0;      // of x/z and y/z: no rectified pair sees so far to the side (79 deg)
constexpr double kLeastShrink = 0.2; // of the inverse depth, by one correction

} // namespace

bool InverseDepth::isDefined(const Eigen::Vector3d& q) {
  return q.z() > kMinDepth && q.head<2>().cwiseAbs().maxCoeff() <= kWidest * q.z();
}

Eigen::Matrix3d InverseDepth::jacobian(const Eigen::Vector3d& q) {
  const double rho = 1.0 / q.z();
  Eigen::Matrix3d J;
  J << rho, 0.0, -q.x() * rho * rho, 0.0, rho, -q.y() * rho * rho, 0.0, 0.0, -rho * rho;
  return J;
}

Eigen::Matrix3d InverseDepth::pointJacobian(const Eigen::Vector3d& q) {
  const double z = q.z();
  Eigen::Matrix3d J;
  J << z, 0.0, -q.x() * z, 0.0, z, -q.y() * z, 0.0, 0.0, -z * z;
  return J;
}

Eigen::Vector3d InverseDepth::moved(const Eigen::Vector3d& q, const Eigen::Vector3d& dq) {
  const double rho = 1.0 / q.z();
  Eigen::Vector3d lambda = Eigen::Vector3d(q.x() * rho, q.y() * rho, rho) + jacobian(q) * dq;
  lambda.z() = std::max(lambda.z(), kLeastShrink * rho);
  return Eigen::Vector3d(lambda.x(), lambda.y(), 1.0) / lambda.z();
}

} // namespace vi_ekf_slam

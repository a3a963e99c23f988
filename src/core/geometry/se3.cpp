#include "vi_ekf_slam/core/geometry/se3.hpp"

#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

SE3 SE3::normalized() const { return {so3::normalized(rotation_), translation_}; }

Eigen::Matrix4d SE3::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = rotation_;
  m.topRightCorner<3, 1>() = translation_;
  return m;
}

Matrix6d SE3::adjoint() const {
  Matrix6d m = Matrix6d::Zero();
  m.topLeftCorner<3, 3>() = rotation_;
  m.topRightCorner<3, 3>() = so3::hat(translation_) * rotation_;
  m.bottomRightCorner<3, 3>() = rotation_;
  return m;
}

SE3 SE3::Exp(const Vector6d& xi) {
  const Eigen::Vector3d phi = xi.tail<3>();
  return {so3::Exp(phi), so3::leftJacobian(phi) * xi.head<3>()};
}

Vector6d SE3::Log() const {
  Vector6d xi;
  xi.tail<3>() = so3::Log(rotation_);
  xi.head<3>() = so3::leftJacobianInverse(xi.tail<3>()) * translation_;
  return xi;
}

namespace se3 {

Eigen::Matrix<double, 3, 6> pointJacobian(const Eigen::Vector3d& x) {
  Eigen::Matrix<double, 3, 6> J;
  J << Eigen::Matrix3d::Identity(), -so3::hat(x);
  return J;
}

Matrix6d leftJacobian(const Vector6d& xi) {
  const Eigen::Vector3d phi = xi.tail<3>();
  const double theta2 = phi.squaredNorm();
  const double theta = std::sqrt(theta2);
  double c1 = 0.0, c2 = 0.0, c3 = 0.0;
  if (theta < 0.1) {
    const double t4 = theta2 * theta2;
    c1 = 1.0 / 6.0 - theta2 / 120.0 + t4 / 5040.0 - t4 * theta2 / 362880.0;
    c2 = 1.0 / 24.0 - theta2 / 720.0 + t4 / 40320.0 - t4 * theta2 / 3628800.0;
    c3 = 1.0 / 120.0 - theta2 / 2520.0 + t4 / 120960.0 - t4 * theta2 / 9979200.0;
  } else {
    const double s = std::sin(theta), c = std::cos(theta);
    c1 = (theta - s) / (theta2 * theta);
    c2 = (theta2 + 2.0 * c - 2.0) / (2.0 * theta2 * theta2);
    c3 = (2.0 * theta - 3.0 * s + theta * c) / (2.0 * theta2 * theta2 * theta);
  }
  const Eigen::Matrix3d P = so3::hat(phi), V = so3::hat(xi.head<3>());
  const Eigen::Matrix3d PV = P * V, VP = V * P, PVP = P * V * P;
  // Barfoot, eq. 7.86b.
  const Eigen::Matrix3d Q =
      0.5 * V + c1 * (PV + VP + PVP) + c2 * (P * PV + VP * P - 3.0 * PVP) + c3 * (PVP * P + P * PVP);
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = so3::leftJacobian(phi);
  J.bottomRightCorner<3, 3>() = J.topLeftCorner<3, 3>();
  J.topRightCorner<3, 3>() = Q;
  return J;
}

} // namespace se3

SE3 levelled(const SE3& pose, const SE3& like) {
  const double turn = so3::heading(pose.rotation() * like.rotation().transpose());
  return {so3::Exp({0.0, 0.0, turn}) * like.rotation(), pose.translation()};
}

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Rigid transform. A variable `a_T_b` takes points from frame b to frame a, and its translation is the
/// origin of b in a. Tangent vectors are (translation, rotation), as the twist (v, omega) of paper eq. 12.
class SE3 {
 public:
  SE3() : rotation_(Eigen::Matrix3d::Identity()), translation_(Eigen::Vector3d::Zero()) {}
  SE3(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation)
      : rotation_(rotation), translation_(translation) {}

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  const Eigen::Vector3d& translation() const { return translation_; }

  SE3 operator*(const SE3& other) const {
    return {rotation_ * other.rotation_, rotation_ * other.translation_ + translation_};
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return rotation_ * point + translation_; }
  SE3 inverse() const { return {rotation_.transpose(), -(rotation_.transpose() * translation_)}; }

  /// The transform with the rotation's rounding errors removed.
  SE3 normalized() const;
  Eigen::Matrix4d matrix() const;
  /// 6x6: Exp(Ad xi) = T Exp(xi) T^-1. Sola et al., "A micro Lie theory", eq. 175.
  Matrix6d adjoint() const;

  /// Ibid., eq. 172.
  static SE3 Exp(const Vector6d& xi);
  /// Ibid., eq. 173; the rotation part has norm <= pi.
  Vector6d Log() const;

 private:
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_;
};

namespace se3 {

/// [I, -hat(x)], the derivative of Exp(xi) x by xi at zero: the upper rows of the operator of paper eq. 19.
Eigen::Matrix<double, 3, 6> pointJacobian(const Eigen::Vector3d& x);

/// Left Jacobian, as so3's. Barfoot, "State Estimation for Robotics", eq. 7.85.
Matrix6d leftJacobian(const Vector6d& xi);

} // namespace se3

/// Where `pose` is and heads, tilted as `like` is: of all turns of `like` about z the one nearest to it.
SE3 levelled(const SE3& pose, const SE3& like);

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam::so3 {

/// Skew-symmetric matrix [v]x with [v]x w = v x w (paper eq. 12, hat of omega).
Eigen::Matrix3d hat(const Eigen::Vector3d& v);

/// Rotation by |phi| rad about phi (Rodrigues). Sola et al., "A micro Lie theory", eq. 132.
Eigen::Matrix3d Exp(const Eigen::Vector3d& phi);

/// Rotation vector in rad, |phi| <= pi, of a rotation matrix. Accurate from 0 to pi.
Eigen::Vector3d Log(const Eigen::Matrix3d& R);

/// Left Jacobian: Exp(phi + d) = Exp(J_l(phi) d) Exp(phi) to first order. Ibid., eq. 145.
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& phi);

/// The integral over s in [0, 1] of (1 - s) Exp(s phi): Hartley et al., IJRR 2020, eq. (84), Gamma_2; Exp and
/// leftJacobian are Gamma_0 and Gamma_1.
Eigen::Matrix3d secondIntegral(const Eigen::Vector3d& phi);

/// Inverse of leftJacobian, for |phi| < 2 pi. Ibid., eq. 146.
Eigen::Matrix3d leftJacobianInverse(const Eigen::Vector3d& phi);

/// The angle about z of R = Rz(heading) T, T a turn about a horizontal axis, rad: the heading of a tilted
/// body.
double heading(const Eigen::Matrix3d& R);

/// Nearest rotation to a nearly orthonormal matrix; undoes the rounding of long products.
Eigen::Matrix3d normalized(const Eigen::Matrix3d& R);

/// Whether R^T R = I and det R = +1 within `tolerance` (largest element).
bool isRotation(const Eigen::Matrix3d& R, double tolerance);

} // namespace vi_ekf_slam::so3

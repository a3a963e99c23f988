#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/types.hpp"

/// Small normal distributions. Eigen's factorisations take long to compile: here they are once for all.
namespace vi_ekf_slam {

/// 6x6 of independent (position, rotation) errors, with these standard deviations on each axis, m and rad.
Matrix6d independentPose(double position_sigma, double rotation_sigma);
/// The same of a pose that is not known at all; `level`: but for its tilt.
Matrix6d anyPose(bool level = false);

/// 3x3 of an error of standard deviation `sigma` on each axis.
inline Eigen::Matrix3d isotropic(double sigma) { return sigma * sigma * Eigen::Matrix3d::Identity(); }

/// S^-1 b; not a number where S is not positive definite.
Eigen::Vector3d solvePositive(const Eigen::Matrix3d& S, const Eigen::Vector3d& b);
Eigen::Matrix3d solvePositive(const Eigen::Matrix3d& S, const Eigen::Matrix3d& B);
Vector6d solvePositive(const Matrix6d& S, const Vector6d& b);

/// What a chi-square of so many degrees of freedom exceeds in 1 % of all cases.
constexpr double kChiSquare3 = 11.345, kChiSquare6 = 16.812;
/// Chi-square, 3 degrees of freedom, 99.99 %: what is farther off is no noise.
constexpr double kContradicts = 21.108;

/// e^T S^-1 e, the squared Mahalanobis distance of an error e of covariance S: chi-square distributed with as
/// many degrees of freedom as e has. Not a number where S is not positive definite.
double squaredMahalanobis(const Eigen::Vector3d& e, const Eigen::Matrix3d& S);
double squaredMahalanobis(const Vector6d& e, const Matrix6d& S);

/// Whether S is finite and its lower triangle that of a positive definite matrix.
bool isPositiveDefinite(const Eigen::Matrix3d& S);
/// Whether the lower triangle of S is that of a positive semidefinite matrix, but for `rounding` of the
/// eigenvalues of its correlations.
bool isPositiveSemidefinite(const Eigen::Ref<const Eigen::MatrixXd>& S, double rounding);

} // namespace vi_ekf_slam

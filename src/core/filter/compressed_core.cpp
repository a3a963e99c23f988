#include "vi_ekf_slam/core/filter/compressed_core.hpp"

#include <cmath>

namespace vi_ekf_slam {

void CompressedCore::open(const Eigen::Vector3d& position, const Eigen::Ref<const Eigen::MatrixXd>& P) {
  if (open_) return;
  open_ = true;
  position_ = position;
  covariance_ = P;
  Phi_.setIdentity(size_, size_);
  Omega_.setZero(size_, size_);
  psi_.setZero(size_);
}

void CompressedCore::correct(const LinearMeasurement& z, const Eigen::MatrixXd& PHt, const SmallMatrix& L) {
  Eigen::MatrixXd weighted = Eigen::MatrixXd::Zero(z.rows(), size_); // H Phi, L^-1 H Phi, then S^-1 H Phi
  z.addProduct(Phi_, weighted);
  L.triangularView<Eigen::Lower>().solveInPlace(weighted);
  Omega_.noalias() += weighted.transpose() * weighted;
  L.transpose().triangularView<Eigen::Upper>().solveInPlace(weighted);
  psi_.noalias() += weighted.transpose() * z.residual();
  Phi_.noalias() -= PHt * weighted;
}

/// By the Cholesky factorisation with the largest pivot of what is left, down to what rounding leaves of
/// zeros.
Eigen::MatrixXd CompressedCore::Gamma() const {
  constexpr double kRounding = 1e-15;
  Eigen::MatrixXd left = Omega_, Gamma(size_, size_);
  const Eigen::VectorXd least = kRounding * Omega_.diagonal();
  Eigen::Index rank = 0;
  for (; rank < size_; ++rank) {
    Eigen::Index pivot = 0;
    (left.diagonal() - least).maxCoeff(&pivot);
    if (!(left(pivot, pivot) > least[pivot])) break;
    Gamma.col(rank) = left.col(pivot) / std::sqrt(left(pivot, pivot));
    left.noalias() -= Gamma.col(rank) * Gamma.col(rank).transpose();
    left.row(pivot).setZero();
    left.col(pivot).setZero();
  }
  return Gamma.leftCols(rank);
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/filter/compressed_core.hpp"

#include <Eigen/Cholesky>

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

void CompressedCore::correct(const Eigen::MatrixXd& PHt, const Eigen::MatrixXd& L, const Eigen::MatrixXd& H,
                             const Eigen::VectorXd& nu) {
  Eigen::MatrixXd weighted = H * Phi_; // L^-1 H Phi, then S^-1 H Phi
  L.triangularView<Eigen::Lower>().solveInPlace(weighted);
  Omega_.noalias() += weighted.transpose() * weighted;
  L.transpose().triangularView<Eigen::Upper>().solveInPlace(weighted);
  psi_.noalias() += weighted.transpose() * nu;
  Phi_.noalias() -= PHt * weighted;
}

/// By the pivoted factorisation Omega = P^T L D L^T P, of which what rounding left of zeros is dropped.
Eigen::MatrixXd CompressedCore::Gamma() const {
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(Omega_);
  const Eigen::VectorXd D = ldlt.vectorD();
  const double least = 1e-15 * D.cwiseAbs().maxCoeff();
  Eigen::Index rank = 0;
  while (rank < D.size() && D[rank] > least) ++rank;
  const Eigen::MatrixXd L = ldlt.matrixL();
  return ldlt.transpositionsP().transpose() * (L.leftCols(rank) * D.head(rank).cwiseSqrt().asDiagonal());
}

} // namespace vi_ekf_slam

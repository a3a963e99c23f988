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

void CompressedCore::correct(const LinearMeasurement& z, const SmallMatrix& L_inverse,
                             const SmallVector& white, const Eigen::MatrixXd& A) {
  Eigen::MatrixXd HPhi_t = Eigen::MatrixXd::Zero(size_, z.rows());
  for (const LinearMeasurement::Term& term : z) {
    const auto rows = Phi_.middleRows(term.column, term.H.cols());
    HPhi_t.noalias() += rows.transpose().lazyProduct(term.H.transpose());
  }
  const Eigen::MatrixXd B = HPhi_t.lazyProduct(L_inverse.transpose());
  Omega_.noalias() += B.lazyProduct(B.transpose());
  psi_.noalias() += B.lazyProduct(white);
  Phi_.noalias() -= A.lazyProduct(B.transpose());
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

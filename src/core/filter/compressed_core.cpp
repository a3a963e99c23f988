#include "vi_ekf_slam/core/filter/compressed_core.hpp"

#include <cmath>

namespace vi_ekf_slam {

void CompressedCore::open(const Eigen::Vector3d& position, const Eigen::Ref<const Eigen::MatrixXd>& P) {
  if (open_) return;
  open_ = true;
  position_ = position;
  covariance_ = P;
  Phi_t_.setIdentity(padded_, size_);
  Omega_.setZero(size_, size_);
  told_.resize(size_, kTold);
  told_columns_ = 0;
  psi_.setZero(size_);
}

/// By the Cholesky factorisation with the largest pivot of what is left, down to what rounding leaves of
/// zeros.
Eigen::MatrixXd CompressedCore::Gamma() const {
  constexpr double kRounding = 1e-15;
  Eigen::MatrixXd left = Omega(), Gamma(size_, size_);
  const Eigen::VectorXd least = kRounding * left.diagonal();
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

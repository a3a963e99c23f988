#include "vi_ekf_slam/core/filter/compressed_core.hpp"

#include <cmath>

namespace vi_ekf_slam {

void CompressedCore::open(const Eigen::Vector3d& position, const Eigen::Ref<const Eigen::MatrixXd>& P) {
  if (open_) return;
  open_ = true;
  position_ = position;
  covariance_ = P;
  Phi_t_.setIdentity(padded_, size_);
  Omega_.setZero(padded_, size_);
  psi_.setZero(size_);
}

void CompressedCore::correct(const LinearMeasurement& z, const SmallMatrix& L_inverse,
                             const SmallVector& white, const CoreColumns& A) {
  CoreColumns HPhi_t = CoreColumns::Zero(padded_, z.rows());
  z.addTransposedProduct(Phi_t_, HPhi_t);
  const CoreColumns B = HPhi_t.lazyProduct(L_inverse.transpose());
  const auto core = B.topRows(size_);
  psi_.noalias() += core.lazyProduct(white);
  const auto learn = [this](const auto& told, const auto& root) {
    Omega_.noalias() += told.lazyProduct(told.topRows(size_).transpose());
    Phi_t_.noalias() -= told.lazyProduct(root.topRows(size_).transpose());
  };
  if (z.rows() == 3)
    learn(B.leftCols<3>(), A.leftCols<3>()); // as most have, which the compiler knows here
  else
    learn(B, A);
}

/// By the Cholesky factorisation with the largest pivot of what is left, down to what rounding leaves of
/// zeros.
Eigen::MatrixXd CompressedCore::Gamma() const {
  constexpr double kRounding = 1e-15;
  Eigen::MatrixXd left = Omega_.topRows(size_), Gamma(size_, size_);
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

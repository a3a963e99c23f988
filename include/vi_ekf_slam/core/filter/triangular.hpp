#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam {

// Dense kernels on lower triangles that halve their matrices again and again, so that nearly all of the work
// is done in products of square matrices, which are fastest, and none of it on what is known to be zero.

/// The lower triangle of C (n x n) += A^T B, where that is symmetric, for A and B (k x n).
void addLowerProduct(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& A,
                     const Eigen::Ref<const Eigen::MatrixXd>& B);

/// The lower triangle of C (n x n) += A^T A, for A (k x n).
inline void addLowerSquare(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& A) {
  addLowerProduct(C, A, A);
}

/// X <- X L^-T for a lower triangular L.
void divideByLowerTransposed(Eigen::Ref<Eigen::MatrixXd> X, const Eigen::Ref<const Eigen::MatrixXd>& L);

/// L <- L^-1 for a lower triangular matrix. Above the diagonal nothing is read or written.
void invertLower(Eigen::Ref<Eigen::MatrixXd> L);

/// The lower triangle of T^T T in the place of T, which is lower triangular.
void squareLower(Eigen::Ref<Eigen::MatrixXd> T);

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam::test {

using LongMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;

/// exp(A) from its power series, scaled and squared, in long double: owes nothing to the closed forms.
inline LongMatrix expSeries(const LongMatrix& A) {
  int squarings = 0;
  LongMatrix scaled = A;
  while (scaled.cwiseAbs().rowwise().sum().maxCoeff() > 0.5L) {
    scaled *= 0.5L;
    ++squarings;
  }
  LongMatrix sum = LongMatrix::Identity(A.rows(), A.cols());
  LongMatrix term = sum;
  for (int k = 1; k <= 30; ++k) {
    term = (term * scaled).eval() / static_cast<long double>(k);
    sum += term;
  }
  for (int i = 0; i < squarings; ++i) sum = (sum * sum).eval();
  return sum;
}

/// The integral of exp(s A) over s in [0, 1], that is the sum of A^k / (k + 1)!: the left Jacobian for A =
/// ad.
inline LongMatrix integratedExpSeries(const LongMatrix& A) {
  const Eigen::Index n = A.rows();
  LongMatrix block = LongMatrix::Zero(2 * n, 2 * n);
  block.topLeftCorner(n, n) = A;
  block.topRightCorner(n, n).setIdentity();
  return expSeries(block).topRightCorner(n, n);
}

} // namespace vi_ekf_slam::test

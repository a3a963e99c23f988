#include "exp_series.hpp"

namespace vi_ekf_slam::test {

LongMatrix expSeries(const LongMatrix& A) {
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

LongMatrix integratedExpSeries(const LongMatrix& A) {
  const Eigen::Index n = A.rows();
  LongMatrix block = LongMatrix::Zero(2 * n, 2 * n);
  block.topLeftCorner(n, n) = A;
  block.topRightCorner(n, n).setIdentity();
  return expSeries(block).topRightCorner(n, n);
}

} // namespace vi_ekf_slam::test

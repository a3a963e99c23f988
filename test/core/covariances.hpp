#pragma once

#include <Eigen/Cholesky>

namespace vi_ekf_slam::test {

/// Whether no eigenvalue of symmetric P is below -`rounding` times P's norm.
inline bool isPositive(Eigen::MatrixXd P, double rounding = 0.0) {
  P.diagonal().array() += rounding * P.norm();
  return Eigen::LLT<Eigen::MatrixXd>(P).info() == Eigen::Success;
}

inline Eigen::MatrixXd inverseOf(const Eigen::MatrixXd& P) {
  return P.llt().solve(Eigen::MatrixXd::Identity(P.rows(), P.cols()));
}

} // namespace vi_ekf_slam::test

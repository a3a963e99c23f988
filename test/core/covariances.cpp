#include "covariances.hpp"

namespace vi_ekf_slam::test {

bool isPositive(Eigen::MatrixXd P, double rounding) {
  P.diagonal().array() += rounding * P.norm();
  return Eigen::LLT<Eigen::MatrixXd>(P).info() == Eigen::Success;
}

Eigen::MatrixXd inverseOf(const Eigen::MatrixXd& P) {
  return P.llt().solve(Eigen::MatrixXd::Identity(P.rows(), P.cols()));
}

} // namespace vi_ekf_slam::test

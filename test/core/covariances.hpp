#pragma once

#include <Eigen/Cholesky>

namespace vi_ekf_slam::test {

/// Whether no eigenvalue of symmetric P is below -`rounding` times P's norm.
bool isPositive(Eigen::MatrixXd P, double rounding = 0.0);

Eigen::MatrixXd inverseOf(const Eigen::MatrixXd& P);

} // namespace vi_ekf_slam::test

#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam {

/// Copies the lower triangle of a square matrix onto the upper one, block by block for the cache's sake.
void mirrorLower(Eigen::Ref<Eigen::MatrixXd> matrix);

/// P <- P - A A^T for symmetric P, which stays symmetric.
void subtractSquare(Eigen::Ref<Eigen::MatrixXd> P, const Eigen::Ref<const Eigen::MatrixXd>& A);

} // namespace vi_ekf_slam

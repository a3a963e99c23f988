#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam::invariant {

/// Copies the lower triangle of a square matrix onto the upper one, block by block for the cache's sake.
void mirrorLower(Eigen::Ref<Eigen::MatrixXd> matrix);

} // namespace vi_ekf_slam::invariant

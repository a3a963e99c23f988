#pragma once

#include "vi_ekf_slam/core/pooled_matrix.hpp"

namespace vi_ekf_slam::invariant {

/// Leaves of a stacked measurement, three rows an item, those that are chosen, in their order: of P H^T (n x
/// 3 items), the lower triangle of S (3 items square) and the innovation (3 items).
void keepChosen(const PooledVector<bool>& chosen, PooledMatrix& PHt, PooledMatrix& S,
                Pooled<Eigen::VectorXd>& innovation);

} // namespace vi_ekf_slam::invariant

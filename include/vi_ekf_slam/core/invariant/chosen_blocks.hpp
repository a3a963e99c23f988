#pragma once

#include <Eigen/Core>
#include <vector>

namespace vi_ekf_slam::invariant {

/// Leaves of a stacked measurement, three rows an item, those that are chosen, in their order: of P H^T (n x
/// 3 items), S (3 items square, of which the lower triangle is enough) and the innovation (3 items).
void keepChosen(const std::vector<bool>& chosen, Eigen::MatrixXd& PHt, Eigen::MatrixXd& S,
                Eigen::VectorXd& innovation);

} // namespace vi_ekf_slam::invariant

#include "vi_ekf_slam/core/filter/symmetric.hpp"

#include <algorithm>

namespace vi_ekf_slam {

void mirrorLower(Eigen::Ref<Eigen::MatrixXd> matrix) {
  constexpr Eigen::Index kBlock = 32;
  const Eigen::Index n = matrix.rows();
  for (Eigen::Index column = 0; column < n; column += kBlock) {
    const Eigen::Index columns = std::min(kBlock, n - column);
    for (Eigen::Index row = column; row < n; row += kBlock) {
      const Eigen::Index rows = std::min(kBlock, n - row);
      if (row == column) {
        matrix.block(row, column, rows, columns).triangularView<Eigen::StrictlyUpper>() =
            matrix.block(row, column, rows, columns).transpose();
      } else {
        matrix.block(column, row, columns, rows) = matrix.block(row, column, rows, columns).transpose();
      }
    }
  }
}

void subtractSquare(Eigen::Ref<Eigen::MatrixXd> P, const Eigen::Ref<const Eigen::MatrixXd>& A) {
  constexpr Eigen::Index kFew = 24; // columns, whose products cost less than mirroring the half of them
  if (A.cols() <= kFew) {
    P.noalias() -= A * A.transpose();
  } else {
    P.selfadjointView<Eigen::Lower>().rankUpdate(A, -1.0);
    mirrorLower(P);
  }
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/filter/inactive_parts.hpp"

#include <utility>

namespace vi_ekf_slam::inactive {

Eigen::MatrixXd StackedRows::middleCols(Eigen::Index column, Eigen::Index count) const {
  Eigen::Index rows = 0, row = 0;
  for (const auto& part : parts_) rows += part->rows();
  Eigen::MatrixXd result(rows, count);
  for (const auto& part : parts_) {
    result.middleRows(row, part->rows()) = part->middleCols(column, count);
    row += part->rows();
  }
  return result;
}

Eigen::MatrixXd StackedRows::columns(const std::vector<Eigen::Index>& list) const {
  Eigen::MatrixXd result(middleCols(0, 0).rows(), static_cast<Eigen::Index>(list.size()));
  for (Eigen::Index column = 0; column < result.cols(); ++column)
    result.col(column) = middleCols(list[static_cast<std::size_t>(column)], 1);
  return result;
}

std::size_t StackedRows::bytes() const {
  Eigen::Index size = 0;
  for (const auto& part : parts_) size += part->size();
  return static_cast<std::size_t>(size) * sizeof(double);
}

void Carried::join(const Eigen::MatrixXd& more_cross, const Eigen::MatrixXd& with_others,
                   const Eigen::MatrixXd& more_own) {
  const Eigen::Index before = rows(), more = more_cross.cols();
  if (more == 0) return;
  cross.conservativeResize(more_cross.rows(), before + more);
  cross.rightCols(more) = more_cross;
  own.conservativeResize(before + more, before + more);
  own.bottomLeftCorner(more, before) = with_others;
  own.topRightCorner(before, more) = with_others.transpose();
  own.bottomRightCorner(more, more) = more_own;
  moved.conservativeResize(before + more);
  moved.tail(more).setZero();
}

Eigen::MatrixXd columnsOf(const Eigen::Ref<const Eigen::MatrixXd>& M, const std::vector<Eigen::Index>& kept) {
  Eigen::MatrixXd result(M.rows(), static_cast<Eigen::Index>(kept.size()));
  for (Eigen::Index column = 0; column < result.cols(); ++column)
    result.col(column) = M.col(kept[static_cast<std::size_t>(column)]);
  return result;
}

Eigen::MatrixXd rowsOf(const Eigen::Ref<const Eigen::MatrixXd>& M, const std::vector<Eigen::Index>& kept) {
  const auto count = static_cast<Eigen::Index>(kept.size());
  if (count == M.rows()) return M;
  Eigen::MatrixXd result(count, M.cols());
  for (Eigen::Index column = 0; column < M.cols(); ++column) {
    for (Eigen::Index row = 0; row < count; ++row)
      result(row, column) = M(kept[static_cast<std::size_t>(row)], column);
  }
  return result;
}

Eigen::MatrixXd rowsOf(const SymmetricPanels& P, const std::vector<Eigen::Index>& kept) {
  Eigen::MatrixXd result(static_cast<Eigen::Index>(kept.size()), P.rows());
  for (Eigen::Index row = 0; row < result.rows(); ++row)
    result.row(row) = P.middleRows(kept[static_cast<std::size_t>(row)], 1);
  return result;
}

} // namespace vi_ekf_slam::inactive

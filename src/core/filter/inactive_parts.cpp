#include "vi_ekf_slam/core/filter/inactive_parts.hpp"

#include <utility>

namespace vi_ekf_slam::inactive {

Eigen::Index StackedRows::rows() const {
  Eigen::Index rows = 0;
  for (const auto& part : parts_) rows += part->rows();
  return rows;
}

Eigen::MatrixXd StackedRows::operator*(const Eigen::Ref<const Eigen::MatrixXd>& R) const {
  Eigen::Index row = 0;
  Eigen::MatrixXd result(rows(), R.cols());
  for (const auto& part : parts_) {
    result.middleRows(row, part->rows()).noalias() = *part * R;
    row += part->rows();
  }
  return result;
}

Eigen::MatrixXd StackedRows::middleCols(Eigen::Index column, Eigen::Index count) const {
  Eigen::Index row = 0;
  Eigen::MatrixXd result(rows(), count);
  for (const auto& part : parts_) {
    result.middleRows(row, part->rows()) = part->middleCols(column, count);
    row += part->rows();
  }
  return result;
}

Eigen::MatrixXd StackedRows::columns(const std::vector<Eigen::Index>& list) const {
  Eigen::MatrixXd result(rows(), static_cast<Eigen::Index>(list.size()));
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

Eigen::MatrixXd Block::back(const Eigen::Ref<const Eigen::MatrixXd>& A) const {
  const Eigen::Index n = passage->F.rows(), n0 = passage->F.cols(), a = A.cols() - n;
  Eigen::MatrixXd result(A.rows(), atBegin());
  result.leftCols(n0).noalias() = A.leftCols(n) * passage->F;
  if (a > 0) result.leftCols(n0).noalias() += A.rightCols(a) * added.all();
  for (Eigen::Index i = n0; i < result.cols(); ++i)
    result.col(i) = A.col(n + through[static_cast<std::size_t>(i - n0)]);
  return result;
}

Eigen::MatrixXd Block::pass(Carried& carried) const {
  const Eigen::Index n = passage->F.rows(), n0 = passage->F.cols();
  const auto C = carried.cross.topRows(n0);
  Eigen::MatrixXd learned = carried.learn(C, passage->information, passage->correction);
  Eigen::MatrixXd at_end(atEnd(), C.cols());
  at_end.topRows(n).noalias() = passage->F * C;
  at_end.bottomRows(added.rows()) = added * C;
  for (std::size_t i = 0; i < through.size(); ++i)
    at_end.row(n + through[i]) += carried.cross.row(n0 + static_cast<Eigen::Index>(i));
  carried.cross.swap(at_end);
  return learned;
}

std::size_t Block::bytes() const {
  const Eigen::Index size = passage->F.size() + passage->information.size() + origin->size() + own->size();
  return static_cast<std::size_t>(size) * sizeof(double) + added.bytes() + cross.bytes();
}

void Since::goBack(const Block& block) {
  const Block::Passage& learned = *block.passage; // by the first ones of its first errors
  correction = block.back(correction.transpose()).transpose();
  correction.head(learned.correction.size()) += learned.correction;
  if (information.size() == 0) return;
  const Eigen::MatrixXd half = block.back(information).transpose();
  information = block.back(half);
  information.topLeftCorner(learned.F.cols(), learned.F.cols()) += learned.information;
}

void grow(Eigen::MatrixXd& matrix, Eigen::Index rows, Eigen::Index cols) {
  if (rows <= matrix.rows() && cols <= matrix.cols()) return;
  const auto enough = [](Eigen::Index needed, Eigen::Index held) {
    return needed <= held ? held : needed + needed / 4;
  };
  matrix.conservativeResize(enough(rows, matrix.rows()), enough(cols, matrix.cols()));
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

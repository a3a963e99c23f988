#include "vi_ekf_slam/core/filter/symmetric_panels.hpp"

#include <algorithm>

namespace vi_ekf_slam {
namespace {

/// Of the `rows` from `row` on those of each panel: f(panel, first row in it, first of the rows, how many).
template <class F>
void forEachPart(Eigen::Index row, Eigen::Index rows, Eigen::Index panel_rows, const F& f) {
  for (Eigen::Index done = 0; done < rows;) {
    const Eigen::Index panel = (row + done) / panel_rows, at = (row + done) % panel_rows;
    const Eigen::Index count = std::min(rows - done, panel_rows - at);
    f(static_cast<std::size_t>(panel), at, done, count);
    done += count;
  }
}

} // namespace

SymmetricPanels::SymmetricPanels(const Eigen::MatrixXd& matrix) {
  resize(matrix.rows());
  set(0, 0, matrix);
}

void SymmetricPanels::resize(Eigen::Index rows) {
  rows_ = rows;
  panels_.resize(static_cast<std::size_t>((rows + kPanel - 1) / kPanel));
  for (std::size_t p = 0; p < panels_.size(); ++p) {
    if (panels_[p].size() == 0) panels_[p].resize(kPanel, firstOf(p) + kPanel);
  }
}

/// What stays moves up and to the left, so that nothing is written over before it is read.
void SymmetricPanels::keep(const std::vector<Eigen::Index>& kept) {
  const auto count = static_cast<Eigen::Index>(kept.size());
  Eigen::Index same = 0; // rows that stay where they are
  while (same < count && kept[static_cast<std::size_t>(same)] == same) ++same;
  for (Eigen::Index column = 0; column < count; ++column) {
    const Eigen::Index from_column = kept[static_cast<std::size_t>(column)];
    for (Eigen::Index row = std::max(same, column); row < count; ++row)
      at(row, column) = at(kept[static_cast<std::size_t>(row)], from_column);
  }
  resize(count);
}

void SymmetricPanels::set(Eigen::Index row, Eigen::Index column, const Eigen::Ref<const Eigen::MatrixXd>& M) {
  forEachPart(row, M.rows(), kPanel,
              [&](std::size_t p, Eigen::Index at, Eigen::Index done, Eigen::Index count) {
                const Eigen::Index columns = std::min(M.cols(), panels_[p].cols() - column);
                if (columns > 0)
                  panels_[p].block(at, column, count, columns) = M.block(done, 0, count, columns);
              });
}

void SymmetricPanels::setProduct(Eigen::Index row, const Eigen::Ref<const Eigen::MatrixXd>& L,
                                 const Eigen::Ref<const Eigen::MatrixXd>& R) {
  forEachPart(row, L.rows(), kPanel,
              [&](std::size_t p, Eigen::Index at, Eigen::Index done, Eigen::Index count) {
                panels_[p].block(at, 0, count, R.cols()).noalias() = L.middleRows(done, count) * R;
              });
}

void SymmetricPanels::subtractProduct(const Eigen::Ref<const Eigen::MatrixXd>& A,
                                      const Eigen::Ref<const Eigen::MatrixXd>& B) {
  for (std::size_t p = 0; firstOf(p) < A.cols(); ++p) {
    const Eigen::Index first = firstOf(p), count = std::min(kPanel, A.cols() - first);
    panels_[p].topLeftCorner(count, first + count).noalias() -=
        A.middleCols(first, count).transpose() * B.leftCols(first + count);
  }
}

double SymmetricPanels::operator()(Eigen::Index row, Eigen::Index column) const {
  if (row < column) std::swap(row, column);
  return panels_[static_cast<std::size_t>(row / kPanel)](row % kPanel, column);
}

Eigen::MatrixXd SymmetricPanels::block(Eigen::Index row, Eigen::Index column, Eigen::Index rows,
                                       Eigen::Index columns) const {
  return Eigen::MatrixXd::NullaryExpr(
      rows, columns, [&](Eigen::Index i, Eigen::Index j) { return (*this)(row + i, column + j); });
}

Eigen::MatrixXd SymmetricPanels::middleRows(Eigen::Index row, Eigen::Index rows) const {
  Eigen::MatrixXd result(rows, rows_);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const auto own = static_cast<std::size_t>((row + i) / kPanel);
    result.row(i).head(row + i + 1) = panels_[own].row((row + i) % kPanel).head(row + i + 1);
    for (std::size_t p = own; p < panels_.size(); ++p) {
      const Eigen::Index first = std::max(firstOf(p), row + i + 1), end = std::min(firstOf(p + 1), rows_);
      if (first >= end) continue;
      result.row(i).segment(first, end - first) =
          panels_[p].col(row + i).segment(first - firstOf(p), end - first).transpose();
    }
  }
  return result;
}

std::size_t SymmetricPanels::bytes() const {
  std::size_t total = 0;
  for (const Eigen::MatrixXd& panel : panels_)
    total += static_cast<std::size_t>(panel.size()) * sizeof(double);
  return total;
}

} // namespace vi_ekf_slam

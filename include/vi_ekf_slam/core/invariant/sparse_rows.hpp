#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/invariant/columns3.hpp"
#include "vi_ekf_slam/core/pooled_matrix.hpp"

namespace vi_ekf_slam::invariant {

/// A measurement matrix H of 3x3 blocks: a measurement touches few of the state's errors. The columns of two
/// blocks are either the same or disjoint.
class SparseRows {
 public:
  /// `value`, whose top left corner is at (row, column).
  struct Block {
    Eigen::Index row, column;
    Eigen::Matrix3d value;
  };

  explicit SparseRows(Eigen::Index rows) : rows_(rows) {}

  void add(Eigen::Index row, Eigen::Index column, const Eigen::Matrix3d& value) {
    blocks_.push_back({row, column, value});
  }

  Eigen::Index rows() const { return rows_; }
  /// In the order in which they were added.
  const PooledVector<Block>& blocks() const { return blocks_; }
  std::size_t bytes() const { return blocks_.size() * sizeof(Block); }

  /// X H^T (m x rows()), for X (m x n).
  template <class Other>
  PooledMatrix timesTransposed(const Eigen::MatrixBase<Other>& X) const {
    PooledMatrix result = PooledMatrix::Zero(X.rows(), rows_);
    for (const Block& b : blocks_)
      addTurned(X.template middleCols<3>(b.column), b.value.transpose(), result.middleCols<3>(b.row));
    return result;
  }

  /// P -= X H + (X H)^T, for symmetric P (n x n) and X (n x rows()).
  template <class Symmetric>
  void subtractSymmetric(Symmetric&& P, const Eigen::Ref<const Eigen::MatrixXd>& X) const {
    // X H by columns first: rows are far apart in memory, and many blocks are of the same columns.
    PooledVector<Eigen::Index> place(static_cast<std::size_t>(P.cols()), -1), columns;
    for (const Block& b : blocks_) {
      Eigen::Index& own = place[static_cast<std::size_t>(b.column)];
      if (own >= 0) continue;
      own = 3 * static_cast<Eigen::Index>(columns.size());
      columns.push_back(b.column);
    }
    PooledMatrix product = PooledMatrix::Zero(P.rows(), 3 * static_cast<Eigen::Index>(columns.size()));
    for (const Block& b : blocks_)
      addTurned(X.middleCols<3>(b.row), b.value,
                product.middleCols<3>(place[static_cast<std::size_t>(b.column)]));
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const auto own = product.middleCols<3>(3 * static_cast<Eigen::Index>(i));
      P.template middleCols<3>(columns[i]) -= own;
      P.template middleRows<3>(columns[i]) -= own.transpose();
    }
  }

  /// result += H^T X, for X (rows() x m).
  template <class Result, class Other>
  void addTransposed(Result&& result, const Eigen::MatrixBase<Other>& X) const {
    for (const Block& b : blocks_) {
      result.template middleRows<3>(b.column).noalias() +=
          b.value.transpose() * X.template middleRows<3>(b.row);
    }
  }

 private:
  Eigen::Index rows_;
  PooledVector<Block> blocks_;
};

} // namespace vi_ekf_slam::invariant

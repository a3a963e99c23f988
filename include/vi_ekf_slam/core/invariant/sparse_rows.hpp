#pragma once

#include <Eigen/Core>
#include <vector>

namespace vi_ekf_slam::invariant {

/// A measurement matrix H of 3x3 blocks: a measurement touches few of the state's errors.
class SparseRows {
 public:
  explicit SparseRows(Eigen::Index rows) : rows_(rows) {}

  /// The block whose top left corner is at (row, column).
  void add(Eigen::Index row, Eigen::Index column, const Eigen::Matrix3d& value) {
    blocks_.push_back({row, column, value});
  }

  Eigen::Index rows() const { return rows_; }
  std::size_t bytes() const { return blocks_.size() * sizeof(Block); }

  /// result -= X H, for X (m x rows()).
  template <class Result>
  void subtractFrom(Result&& result, const Eigen::MatrixXd& X) const {
    for (const Block& b : blocks_) {
      result.template middleCols<3>(b.column).noalias() -= X.middleCols<3>(b.row) * b.value;
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
  struct Block {
    Eigen::Index row, column;
    Eigen::Matrix3d value;
  };

  Eigen::Index rows_;
  std::vector<Block> blocks_;
};

} // namespace vi_ekf_slam::invariant

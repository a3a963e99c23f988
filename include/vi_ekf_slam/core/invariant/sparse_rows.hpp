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

  /// X H^T (m x rows()), for X (m x n).
  template <class Other>
  Eigen::MatrixXd timesTransposed(const Eigen::MatrixBase<Other>& X) const {
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(X.rows(), rows_);
    for (const Block& b : blocks_) {
      result.middleCols<3>(b.row).noalias() += X.template middleCols<3>(b.column) * b.value.transpose();
    }
    return result;
  }

  /// P -= X H + (X H)^T, for symmetric P (n x n) and X (n x rows()).
  template <class Symmetric>
  void subtractSymmetric(Symmetric&& P, const Eigen::MatrixXd& X) const {
    for (const Block& b : blocks_) {
      const Eigen::Matrix<double, Eigen::Dynamic, 3> product = X.middleCols<3>(b.row) * b.value;
      P.template middleCols<3>(b.column) -= product;
      P.template middleRows<3>(b.column) -= product.transpose();
    }
  }

  /// result += H X, for X (n x m).
  void addProduct(Eigen::MatrixXd& result, const Eigen::MatrixXd& X) const {
    for (const Block& b : blocks_)
      result.middleRows<3>(b.row).noalias() += b.value * X.middleRows<3>(b.column);
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

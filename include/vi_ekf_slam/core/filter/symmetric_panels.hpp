#pragma once

#include <Eigen/Core>
#include <vector>

namespace vi_ekf_slam {

/// A large symmetric matrix by its lower triangle, in panels of rows: it grows without being copied, and what
/// is above the diagonal takes neither memory nor time.
class SymmetricPanels {
 public:
  SymmetricPanels() = default;
  /// Of a symmetric matrix, of which the lower triangle is read.
  explicit SymmetricPanels(const Eigen::MatrixXd& matrix);

  Eigen::Index rows() const { return rows_; }
  /// The first rows and columns stay; new ones have any value.
  void resize(Eigen::Index rows);
  /// The rows (and columns) `kept` alone, which are in their order.
  void keep(const std::vector<Eigen::Index>& kept);

  /// M (m x k) in the place of the elements from (row, column) on; what lies above the diagonal is left out.
  void set(Eigen::Index row, Eigen::Index column, const Eigen::Ref<const Eigen::MatrixXd>& M);
  /// The rows from `row` on, in the columns before `row`, become L R (m x n times n x row).
  void setProduct(Eigen::Index row, const Eigen::Ref<const Eigen::MatrixXd>& L,
                  const Eigen::Ref<const Eigen::MatrixXd>& R);
  /// The first m rows and columns -= A^T B, which is symmetric, for A and B (k x m).
  void subtractProduct(const Eigen::Ref<const Eigen::MatrixXd>& A,
                       const Eigen::Ref<const Eigen::MatrixXd>& B);

  double operator()(Eigen::Index row, Eigen::Index column) const;
  /// (m x k)
  Eigen::MatrixXd block(Eigen::Index row, Eigen::Index column, Eigen::Index rows, Eigen::Index columns) const;
  /// Whole rows (m x rows()).
  Eigen::MatrixXd middleRows(Eigen::Index row, Eigen::Index rows) const;

  std::size_t bytes() const;

 private:
  static constexpr Eigen::Index kPanel = 256; ///< rows

  /// In the lower triangle.
  double& at(Eigen::Index row, Eigen::Index column) {
    return panels_[static_cast<std::size_t>(row / kPanel)](row % kPanel, column);
  }
  static Eigen::Index firstOf(std::size_t panel) { return static_cast<Eigen::Index>(panel) * kPanel; }

  Eigen::Index rows_ = 0;
  std::vector<Eigen::MatrixXd> panels_; ///< each kPanel x (its first row + kPanel)
};

} // namespace vi_ekf_slam

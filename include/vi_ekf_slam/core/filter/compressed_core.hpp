#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/filter/linear_measurement.hpp"

namespace vi_ekf_slam {

constexpr Eigen::Index kMostCoreRows = 64;
/// Columns of a core's rows, one, as many as a measurement has or as the core, without memory of their own.
using CoreVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMostCoreRows, 1>;
template <int kColumns>
using CoreColumns = Eigen::Matrix<double, Eigen::Dynamic, kColumns, Eigen::ColMajor, kMostCoreRows,
                                  kColumns == Eigen::Dynamic ? 6 : kColumns>;
using CoreSquare =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostCoreRows, kMostCoreRows>;

/// What a period in which only the first c errors (pose, motion, biases) take part does to all the others:
/// with x0 the core's errors when it began, they are Phi x0 (and noise) now, and any other error r, whose
/// covariance with x0 was P_r0, has
///
///   P_rc' = P_r0 Phi^T,   P_rr' = P_rr - P_r0 Omega P_0r,   r^' = r^ + P_r0 psi.
///
/// So a sample of an IMU costs what c costs, however many landmarks there are (the same algebra as
/// InactiveStore's). Phi is kept transposed, and columns are padded with zeros, so that each step works on
/// whole vectors of the processor.
class CompressedCore {
 public:
  explicit CompressedCore(Eigen::Index size) : size_(size), padded_((size + kPad - 1) / kPad * kPad) {}

  /// Rows with the padding.
  Eigen::Index padded() const { return padded_; }
  bool isOpen() const { return open_; }
  /// Begins a period, if none is under way, with the body at `position` (world, m) and the core's covariance
  /// `P` (c x c).
  void open(const Eigen::Vector3d& position, const Eigen::Ref<const Eigen::MatrixXd>& P);
  void close() { open_ = false; }

  /// The core's errors move: the rows from `row` on become F (k x w) times the rows [row, row + w).
  template <class Matrix>
  void transform(Eigen::Index row, const Matrix& F) {
    const CoreSquare moved = Phi_t_.middleCols(row, F.cols()).lazyProduct(F.transpose());
    Phi_t_.middleCols(row, F.rows()) = moved;
  }
  /// They are corrected by a measurement with S = L L^T: L^-1, L^-1 residual, and A = P H^T L^-T, padded with
  /// zeros (r columns).
  template <class Matrix, class Vector, class Columns>
  void correct(const LinearMeasurement& z, const Matrix& L_inverse, const Vector& white, const Columns& A) {
    Columns HPhi_t = Columns::Zero(padded_, z.rows());
    z.addTransposedProduct(Phi_t_, HPhi_t);
    const Columns B = HPhi_t.lazyProduct(L_inverse.transpose());
    const auto core = B.topRows(size_);
    psi_.noalias() += core.lazyProduct(white);
    if (told_columns_ + z.rows() > told_.cols()) {
      Omega_ = Omega();
      told_columns_ = 0;
    }
    told_.middleCols(told_columns_, z.rows()) = core;
    told_columns_ += z.rows();
    Phi_t_.noalias() -= B.lazyProduct(A.topRows(size_).transpose());
  }

  auto Phi() const { return Phi_t_.topRows(size_).transpose(); }
  auto Phi() { return Phi_t_.topRows(size_).transpose(); }
  /// Gamma with Omega = Gamma Gamma^T, c x rank.
  Eigen::MatrixXd Gamma() const;
  const Eigen::VectorXd& psi() const { return psi_; }
  /// Where the body was when the period began, and the core's covariance then.
  const Eigen::Vector3d& position() const { return position_; }
  const Eigen::MatrixXd& covariance() const { return covariance_; }

 private:
  static constexpr Eigen::Index kPad = 8;   ///< numbers of the widest vectors
  static constexpr Eigen::Index kTold = 96; ///< columns: what one large product is faster for than many small

  Eigen::MatrixXd Omega() const {
    const auto told = told_.leftCols(told_columns_);
    return Omega_ + told * told.transpose();
  }

  Eigen::Index size_, padded_;
  bool open_ = false;
  Eigen::MatrixXd Phi_t_; ///< padded_ rows
  Eigen::MatrixXd Omega_, covariance_;
  Eigen::MatrixXd told_; ///< of Omega what has not been added to it: the first told_columns_ columns
  Eigen::Index told_columns_ = 0;
  Eigen::VectorXd psi_;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
};

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/invariant/sparse_rows.hpp"
#include "vi_ekf_slam/core/pooled_matrix.hpp"

namespace vi_ekf_slam::invariant {

/// The Kalman update by a stereo frame, for what it is: each three rows measure one landmark from the body,
/// z = J (e - xi_p) + noise of covariance R, with J invertible. What is measured is, but for the noise, a
/// part of the state itself, so that with A = R J^-T its covariance afterwards is that of S^-1 alone,
///
///   cov(e_i - xi_p, e_j - xi_p) = [i = j] A_i^T R^-1 A_i - A_i^T (S^-1)_ij A_j,
///
/// and P - (P H^T) S^-1 (P H^T)^T has to be worked out for the other errors only. Exact, at less than half of
/// the operations, a third with the gain.
class RelativeUpdate {
 public:
  /// From P H^T (n x rows), the lower triangular factor of S, and R. Nothing where H is another one, or where
  /// so few of the landmarks are measured that the general form is faster.
  static std::optional<RelativeUpdate> make(const SparseRows& H, const Eigen::Matrix3d& noise,
                                            const PooledMatrix& PHt, const PooledMatrix& L);

  bool isFinite() const { return S_inverse_.allFinite() && gain_.allFinite(); }

  /// K^T (rows x n).
  PooledMatrix transposedGain();

  /// P <- T (P - K S K^T) T^T, where T re-expresses the landmarks' errors relative to the body, e_j - xi_p <-
  /// M_j (e_j - xi_p), or is the identity where M is empty.
  void correct(Eigen::Ref<Eigen::MatrixXd> P, const PooledVector<Eigen::Matrix3d>& M) const;

 private:
  struct Seen {
    Eigen::Index row;          ///< of the state, the first of three
    Eigen::Matrix3d J_inverse; ///< m/px
  };

  struct Others {
    PooledMatrix own;   ///< covariance of the errors of what is not seen
    PooledMatrix cross; ///< with e_i - xi_p of what is
  };

  RelativeUpdate(PooledVector<Seen> seen, PooledVector<Eigen::Index> others, const Eigen::Matrix3d& noise,
                 const PooledMatrix& PHt, const PooledMatrix& L);
  Others correctOthers(const Eigen::Ref<const Eigen::MatrixXd>& P, const PooledVector<Eigen::Matrix3d>& A,
                       const PooledVector<Eigen::Matrix3d>& M) const;

  PooledVector<Seen> seen_;
  PooledVector<Eigen::Index> others_; // each the first of three rows of the state; the position's come first
  Eigen::Matrix3d noise_;
  PooledMatrix S_inverse_; // up to its 3x3 diagonal blocks; the whole once the gain was asked for
  PooledMatrix weighted_;  // of the others: P H^T L^-T
  PooledMatrix gain_;      // of the others: P H^T S^-1
};

} // namespace vi_ekf_slam::invariant

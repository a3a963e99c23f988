#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/filter/four_by_three.hpp"
#include "vi_ekf_slam/core/filter/innovation.hpp"
#include "vi_ekf_slam/core/filter/variables.hpp"

namespace vi_ekf_slam {

/// The Kalman update by measurements of three rows that each measure three errors of their own directly,
/// z_i = J_i (y_i + G_i c) + noise of covariance R_i with J_i invertible, c being few others (calibration).
/// What is measured is, but for the noise, a part of the state itself, so that with A_i = R_i J_i^-T the
/// covariance of y + G c afterwards is that of S^-1 alone,
///
///   cov(i, j) = [i = j] A_i^T R_i^-1 A_i - A_i^T (S^-1)_ij A_j,
///
/// and P - (P H^T) S^-1 (P H^T)^T has to be worked out for the other errors only. Exact, at less than half of
/// the operations.
class DirectUpdate {
 public:
  /// Nothing where the measurements are others, where so few errors are measured that the general form is
  /// faster, or where S is so large beside R that rounding would show. `in` is factorised.
  static std::optional<DirectUpdate> make(const Innovation& in);

  bool isFinite() const { return S_inverse_.allFinite() && gain_.allFinite(); }
  Eigen::MatrixXd inverseS() const;

  /// X <- T (X - K H X) of rows of the error, with `HX` and `weighted`, S^-1 H X (rows x columns of X): what
  /// is measured is R S^-1 H X afterwards.
  void correctRows(Eigen::Ref<Eigen::MatrixXd> X, const Eigen::Ref<const Eigen::MatrixXd>& HX,
                   const Eigen::Ref<const Eigen::MatrixXd>& weighted,
                   const std::vector<Variables::Reexpressed>& points) const;

  /// P <- T (P - K S K^T) T^T, where T re-expresses points.
  void correct(Eigen::Ref<Eigen::MatrixXd> P, const std::vector<Variables::Reexpressed>& points) const;

 private:
  struct Seen {
    Eigen::Index row;                            ///< of the errors, the first of three
    Eigen::Matrix3d J_inverse;                   ///< m/px
    Eigen::Matrix3d noise;                       ///< R
    std::vector<LinearMeasurement::Term> others; ///< G, by J^-1
  };
  /// What `points` make of it, by measurement.
  struct Moved {
    struct Others {
      Eigen::Index row;
      LinearFunction N; ///< to be added to y's rows
    };
    std::vector<Eigen::Matrix3d> A, weighted_A; ///< R J^-T and J^-T, of y as it is re-expressed
    std::vector<FourByThree> A_transposed;
    std::vector<Others> others;
    std::vector<Variables::Reexpressed> unseen; ///< the points that are not measured
  };

  DirectUpdate(const Innovation& in, std::vector<Seen> seen, std::vector<Eigen::Index> rest);
  Moved movedBy(const std::vector<Variables::Reexpressed>& points) const;

  std::vector<Seen> seen_;
  std::vector<Eigen::Index> rest_; ///< rows
  Eigen::MatrixXd S_inverse_;      ///< lower triangle, by blocks
  Eigen::MatrixXd weighted_;       ///< of the rest: P H^T L^-T
  Eigen::MatrixXd gain_;           ///< of the rest: P H^T S^-1
};

/// P <- T P T^T, where T re-expresses points, y <- M y + N x.
void reexpress(Eigen::Ref<Eigen::MatrixXd> P, const std::vector<Variables::Reexpressed>& points);

/// X <- T X of the error's rows.
template <class Matrix>
void reexpressRows(Matrix&& X, const std::vector<Variables::Reexpressed>& points) {
  for (Eigen::Index column = 0; column < X.cols(); ++column) {
    for (const auto& point : points) {
      const Eigen::Vector3d own = X.col(column).template segment<3>(point.row);
      X.col(column).template segment<3>(point.row).noalias() = point.M * own;
    }
  }
  for (const auto& [row, M, N] : points) {
    if (!N.isNone()) X.template middleRows<3>(row).noalias() += N.J * X.middleRows(N.row, N.J.cols());
  }
}

} // namespace vi_ekf_slam

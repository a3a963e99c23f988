#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

#include "vi_ekf_slam/core/filter/linear_measurement.hpp"

namespace vi_ekf_slam {

/// How many are chosen.
inline std::size_t countTrue(const std::vector<bool>& chosen) {
  return static_cast<std::size_t>(std::count(chosen.begin(), chosen.end(), true));
}

/// Measurements that may correct a filter together: P H^T, S = H P H^T + R, and what comes of them. To be
/// made and used between two changes of the filter.
class Innovation {
 public:
  /// `P`: the covariance of the errors that the measurements' terms speak of.
  Innovation(const Eigen::Ref<const Eigen::MatrixXd>& P, std::vector<LinearMeasurement> measurements);

  const std::vector<LinearMeasurement>& measurements() const { return measurements_; }
  /// Of those that take part: all, until putFirst.
  Eigen::Index rows() const { return first_[used_]; }
  /// The first row of measurement i; of i = count, the number of all.
  Eigen::Index rowOf(std::size_t i) const { return first_[i]; }
  /// The block of S of measurements i >= j. Until factorise.
  auto S(std::size_t i, std::size_t j) const {
    return S_.block(first_[i], first_[j], first_[i + 1] - first_[i], first_[j + 1] - first_[j]);
  }
  /// Its lower triangle, by blocks. Until factorise.
  const Eigen::MatrixXd& S() const { return S_; }
  /// Of measurement i alone: residual^T S_ii^-1 residual; not a number where S_ii is not positive definite.
  /// After factorise for those that wait, with residual and S_ii given all that take part.
  double nisOf(std::size_t i) const;

  /// The chosen ones take part, the others wait behind them; each in their order.
  void putFirst(const std::vector<bool>& chosen);
  /// Those that wait are forgotten.
  void drop();

  /// Factorises S. False where that is not positive definite, or something is not finite: it cannot be used.
  bool factorise();
  /// After factorise: of those that wait, which are `passes.size()`, the chosen ones take part too, the
  /// others are forgotten. False as above.
  bool accept(const std::vector<bool>& passes);

  // After factorise:
  /// HX = H X, for X with the rows of the errors.
  void applyH(const Eigen::Ref<const Eigen::MatrixXd>& X, Eigen::Ref<Eigen::MatrixXd> HX) const;
  /// Normalised innovation squared of all: residual^T S^-1 residual.
  double nis() const { return nis_; }
  /// What the errors are expected to be: P H^T S^-1 residual.
  const Eigen::VectorXd& error() const { return error_; }
  Eigen::MatrixXd PHt() const;
  /// Of these rows of P H^T alone.
  Eigen::MatrixXd PHt(const std::vector<Eigen::Index>& chosen) const;
  /// H P H^T + R on the diagonal.
  double variance(Eigen::Index row) const { return variance_[row]; }
  /// Lower triangular, S = L L^T; above it is nothing to be read.
  auto L() const { return S_.topLeftCorner(rows(), rows()); }
  auto residual() const { return residual_.head(rows()); }

 private:
  void stack();
  bool solve();

  std::vector<LinearMeasurement> measurements_;
  std::size_t used_ = 0;                     ///< the first so many take part
  std::vector<Eigen::Index> first_, column_; ///< column: of each row in PHt, which nothing is moved in
  Eigen::VectorXd residual_;                 ///< of those that wait, once factorised, given the others
  Eigen::VectorXd white_;                    ///< L^-1 residual
  Eigen::VectorXd error_, variance_;
  Eigen::MatrixXd PHt_, S_; ///< of S the lower triangle, by blocks
  double nis_ = 0.0;
};

} // namespace vi_ekf_slam

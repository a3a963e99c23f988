#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "vi_ekf_slam/core/filter/linear_measurement.hpp"

namespace vi_ekf_slam {

/// Measurements that may correct a filter together: P H^T, S = H P H^T + R, and what comes of them. To be made
/// and used between two changes of the filter.
class Innovation {
 public:
  /// `P`: the covariance of the errors that the measurements' terms speak of.
  Innovation(const Eigen::Ref<const Eigen::MatrixXd>& P, std::vector<LinearMeasurement> measurements);

  const std::vector<LinearMeasurement>& measurements() const { return measurements_; }
  Eigen::Index rows() const { return first_.back(); }
  /// The first row of measurement i; of i = count, rows().
  Eigen::Index rowOf(std::size_t i) const { return first_[i]; }
  /// The block of S of measurements i >= j. Until factorise.
  auto S(std::size_t i, std::size_t j) const {
    return S_.block(first_[i], first_[j], first_[i + 1] - first_[i], first_[j + 1] - first_[j]);
  }
  /// Of measurement i alone: residual^T S_ii^-1 residual; not a number where S_ii is not positive definite.
  double nisOf(std::size_t i) const;

  /// Leaves the chosen ones alone, in their order.
  void keep(const std::vector<bool>& chosen);

  /// Factorises S. False where that is not positive definite, or something is not finite: it cannot be used.
  bool factorise();

  // After factorise:
  /// Normalised innovation squared of all: residual^T S^-1 residual.
  double nis() const { return nis_; }
  /// What the errors are expected to be: P H^T S^-1 residual.
  const Eigen::VectorXd& error() const { return error_; }
  const Eigen::MatrixXd& PHt() const { return PHt_; }
  /// Lower triangular, S = L L^T; above it is nothing to be read.
  const Eigen::MatrixXd& L() const { return S_; }
  const Eigen::VectorXd& residual() const { return residual_; }

 private:
  void stack();

  std::vector<LinearMeasurement> measurements_;
  std::vector<Eigen::Index> first_;
  Eigen::VectorXd residual_, error_;
  Eigen::MatrixXd PHt_, S_; ///< of S the lower triangle, by blocks
  double nis_ = 0.0;
};

} // namespace vi_ekf_slam

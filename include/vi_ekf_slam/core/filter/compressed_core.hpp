#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/filter/linear_measurement.hpp"

namespace vi_ekf_slam {

/// What a period in which only the first c errors (pose, motion, biases) take part does to all the others:
/// with x0 the core's errors when it began, they are Phi x0 (and noise) now, and any other error r, whose
/// covariance with x0 was P_r0, has
///
///   P_rc' = P_r0 Phi^T,   P_rr' = P_rr - P_r0 Omega P_0r,   r^' = r^ + P_r0 psi.
///
/// So a sample of an IMU costs what c costs, however many landmarks there are (the same algebra as
/// InactiveStore's).
class CompressedCore {
 public:
  explicit CompressedCore(Eigen::Index size) : size_(size) {}

  bool isOpen() const { return open_; }
  /// Begins a period, if none is under way, with the body at `position` (world, m) and the core's covariance
  /// `P` (c x c).
  void open(const Eigen::Vector3d& position, const Eigen::Ref<const Eigen::MatrixXd>& P);
  void close() { open_ = false; }

  /// The core's errors move: the rows from `row` on become F (k x w) times the rows [row, row + w).
  void transform(Eigen::Index row, const Eigen::MatrixXd& F) {
    Phi_.middleRows(row, F.rows()) = F.lazyProduct(Phi_.middleRows(row, F.cols())).eval();
  }
  /// They are corrected by a measurement with S = L L^T: L^-1, L^-1 residual, and A = P H^T L^-T (c x r).
  void correct(const LinearMeasurement& z, const SmallMatrix& L_inverse, const SmallVector& white,
               const Eigen::MatrixXd& A);

  const Eigen::MatrixXd& Phi() const { return Phi_; }
  Eigen::MatrixXd& Phi() { return Phi_; }
  /// Gamma with Omega = Gamma Gamma^T, c x rank.
  Eigen::MatrixXd Gamma() const;
  const Eigen::VectorXd& psi() const { return psi_; }
  /// Where the body was when the period began, and the core's covariance then.
  const Eigen::Vector3d& position() const { return position_; }
  const Eigen::MatrixXd& covariance() const { return covariance_; }

 private:
  Eigen::Index size_;
  bool open_ = false;
  Eigen::MatrixXd Phi_, Omega_, covariance_;
  Eigen::VectorXd psi_;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
};

} // namespace vi_ekf_slam

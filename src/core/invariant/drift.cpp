#include "vi_ekf_slam/core/invariant/drift.hpp"

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"

namespace vi_ekf_slam::invariant {

void Drift::drive(const Eigen::Vector3d& position, double distance) {
  turn(position, Eigen::Vector3d::Constant(distance * rotation2_));
  covariance_.diagonal().head<3>().array() += distance * position2_;
}

void Drift::turn(const Eigen::Vector3d& position, const Eigen::Vector3d& variances) {
  // Turning by w about p leaves p where it is: xi_R = w, xi_p = -w x p.
  Eigen::Matrix<double, 6, 3> J;
  J << so3::hat(position), Eigen::Matrix3d::Identity();
  covariance_ += J * variances.asDiagonal() * J.transpose();
}

Matrix6d Drift::take() {
  const Matrix6d taken = covariance_;
  covariance_.setZero();
  return taken;
}

Matrix6d Drift::ofPose(const Eigen::Vector3d& position) const {
  return alongWorldAxes(covariance_, position);
}

Eigen::Matrix3d Drift::ofPoint(const Eigen::Vector3d& point) const {
  return ofPose(point).topLeftCorner<3, 3>();
}

} // namespace vi_ekf_slam::invariant

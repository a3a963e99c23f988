#pragma once

#include <vector>

#include "states.hpp"

namespace vi_ekf_slam::test {

/// The joint EKF over active and inactive landmarks as plainly as it can be written: one dense covariance of
/// (xi, dnu, db, e of the active, d of the inactive), explicit Jacobians, every step at once.
struct DenseJoint {
  SE3 pose;
  Vector6d twist, bias;
  std::vector<Landmark> active, inactive;
  Eigen::MatrixXd P;

  explicit DenseJoint(const State& state)
      : pose(state.pose()),
        twist(state.twist()),
        bias(state.bias()),
        active(state.landmarks().begin(), state.landmarks().end()),
        P(state.covariance()) {}

  Eigen::Index offset(std::size_t i) const { return State::offsetOf(i); }
  Eigen::Index inactiveOffset(std::size_t i) const { return State::offsetOf(active.size() + i); }

  Eigen::MatrixXd identity() const { return Eigen::MatrixXd::Identity(P.rows(), P.rows()); }

  void transform(const Eigen::MatrixXd& F);
  void addNoise(const Eigen::MatrixXd& G, const Eigen::MatrixXd& Q);
  void propagate(double dt, const ProcessNoise& noise);
  void update(const Eigen::MatrixXd& H, const Eigen::MatrixXd& R, const Eigen::VectorXd& innovation,
              const SE3* cam_T_imu);
  void addLandmark(FeatureId id, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise);

  /// Keeps the three rows of these offsets, in this order, after the first kLandmarks.
  void select(const std::vector<Eigen::Index>& offsets);
  std::vector<Eigen::Index> offsets() const;
  void removeActive(std::size_t index);
  void removeInactive(std::size_t index);
  void deactivate(std::size_t index, const Eigen::Matrix3d& slid = Eigen::Matrix3d::Zero());
  void activate(FeatureId id);
  void forget(Eigen::Index row, const Eigen::Vector3d& sigma);
  void loosen(const Matrix6d& noise);
};

} // namespace vi_ekf_slam::test

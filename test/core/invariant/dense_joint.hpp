#pragma once

#include <Eigen/LU>
#include <algorithm>
#include <numeric>
#include <vector>

#include "states.hpp"
#include "vi_ekf_slam/core/invariant/inverse_depth.hpp"

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
        active(state.landmarks()),
        P(state.covariance()) {}

  Eigen::Index offset(std::size_t i) const { return State::offsetOf(i); }
  Eigen::Index inactiveOffset(std::size_t i) const { return State::offsetOf(active.size() + i); }

  void transform(const Eigen::MatrixXd& F) { P = (F * P * F.transpose()).eval(); }
  Eigen::MatrixXd identity() const { return Eigen::MatrixXd::Identity(P.rows(), P.rows()); }

  void propagate(double dt, const ProcessNoise& noise) {
    Eigen::MatrixXd G = Eigen::MatrixXd::Zero(P.rows(), 6);
    G.topRows<6>() = dt * pose.adjoint() * se3::leftJacobian(dt * twist);
    for (std::size_t i = 0; i < active.size(); ++i)
      G.middleRows<3>(offset(i)) = so3::hat(active[i].position) * G.middleRows<3>(kRotation);
    Eigen::MatrixXd F = identity();
    F.middleCols<6>(kTwist) += G;
    transform(F);
    const Matrix6d Q = dt * Matrix6d(noise.twist_density.cwiseAbs2().asDiagonal());
    Eigen::MatrixXd T = Eigen::MatrixXd::Zero(P.rows(), 6);
    T.middleRows<6>(kTwist).setIdentity();
    P += G * (Q / 3.0) * G.transpose() + G * (Q / 2.0) * T.transpose() + T * (Q / 2.0) * G.transpose() +
         T * Q * T.transpose();
    P.diagonal().segment<6>(kBias) += dt * noise.bias_density.cwiseAbs2();
    pose = (pose * SE3::Exp(dt * twist)).normalized();
  }

  void update(const Eigen::MatrixXd& H, const Eigen::MatrixXd& R, const Eigen::VectorXd& innovation,
              const SE3* cam_T_imu) {
    const Eigen::MatrixXd K = P * H.transpose() * (H * P * H.transpose() + R).inverse();
    transform(identity() - K * H);
    P += K * R * K.transpose();
    const Eigen::VectorXd error = K * innovation;
    const Eigen::Vector3d xi_p = error.segment<3>(kPosition), xi_R = error.segment<3>(kRotation);
    pose = SE3(so3::Exp(xi_R) * pose.rotation(), pose.translation() + xi_p + xi_R.cross(pose.translation()));
    twist += error.segment<6>(kTwist);
    bias += error.segment<6>(kBias);
    for (std::size_t i = 0; i < inactive.size(); ++i)
      inactive[i].position += error.segment<3>(inactiveOffset(i));
    Eigen::MatrixXd F = identity();
    for (std::size_t i = 0; i < active.size(); ++i) {
      Eigen::Vector3d& m = active[i].position;
      const Eigen::Vector3d d = error.segment<3>(offset(i)) + xi_R.cross(m);
      const SE3 cam_T_world = cam_T_imu ? *cam_T_imu * pose.inverse() : SE3();
      const Eigen::Vector3d q = cam_T_world * m;
      if (!cam_T_imu || !InverseDepth::isDefined(q)) {
        m += d;
        continue;
      }
      const Eigen::Matrix3d C = cam_T_world.rotation();
      const Eigen::Vector3d moved = InverseDepth::moved(q, C * d);
      m = cam_T_world.inverse() * moved;
      const Eigen::Matrix3d M =
          C.transpose() * InverseDepth::pointJacobian(moved) * InverseDepth::jacobian(q) * C;
      F.block<3, 3>(offset(i), offset(i)) = M;
      F.block<3, 3>(offset(i), kPosition) = Eigen::Matrix3d::Identity() - M;
    }
    transform(F);
  }

  void addLandmark(FeatureId id, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise) {
    const Eigen::Index n = P.rows(), at = offset(active.size());
    Eigen::MatrixXd F = Eigen::MatrixXd::Zero(n + 3, n);
    F.topLeftCorner(at, at).setIdentity();
    F.block<3, 3>(at, kPosition).setIdentity();
    F.bottomRightCorner(n - at, n - at).setIdentity();
    transform(F);
    P.block<3, 3>(at, at) += noise;
    active.push_back({id, position});
  }

  /// Keeps the three rows of these offsets, in this order, after the first kLandmarks.
  void select(const std::vector<Eigen::Index>& offsets) {
    Eigen::MatrixXd F =
        Eigen::MatrixXd::Zero(kLandmarks + 3 * static_cast<Eigen::Index>(offsets.size()), P.rows());
    F.topLeftCorner<kLandmarks, kLandmarks>().setIdentity();
    Eigen::Index row = kLandmarks;
    for (const Eigen::Index from : offsets) {
      F.block<3, 3>(row, from).setIdentity();
      row += 3;
    }
    transform(F);
  }

  std::vector<Eigen::Index> offsets() const {
    std::vector<Eigen::Index> all;
    for (std::size_t i = 0; i < active.size() + inactive.size(); ++i) all.push_back(offset(i));
    return all;
  }

  void removeActive(std::size_t index) {
    std::vector<Eigen::Index> kept = offsets();
    kept[index] = kept[active.size() - 1];
    kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(active.size()) - 1);
    select(kept);
    active[index] = active.back();
    active.pop_back();
  }

  void removeInactive(std::size_t index) {
    std::vector<Eigen::Index> kept = offsets();
    kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(active.size() + index));
    select(kept);
    inactive.erase(inactive.begin() + static_cast<std::ptrdiff_t>(index));
  }

  void deactivate(std::size_t index) {
    const Landmark gone = active[index];
    Eigen::MatrixXd F = identity();
    F.block<3, 3>(offset(index), kRotation) = -so3::hat(gone.position);
    transform(F);
    std::vector<Eigen::Index> order = offsets();
    order.push_back(order[index]);
    order[index] = order[active.size() - 1];
    order.erase(order.begin() + static_cast<std::ptrdiff_t>(active.size()) - 1);
    select(order);
    active[index] = active.back();
    active.pop_back();
    inactive.push_back(gone);
  }

  void activate(FeatureId id) {
    const auto found =
        std::find_if(inactive.begin(), inactive.end(), [id](const Landmark& l) { return l.id == id; });
    const auto index = static_cast<std::size_t>(found - inactive.begin());
    Landmark back = *found;
    back.anchored = true;
    Eigen::MatrixXd F = identity();
    F.block<3, 3>(inactiveOffset(index), kRotation) = so3::hat(back.position);
    transform(F);
    std::vector<Eigen::Index> order = offsets();
    const Eigen::Index from = order[active.size() + index];
    order.erase(order.begin() + static_cast<std::ptrdiff_t>(active.size() + index));
    order.insert(order.begin() + static_cast<std::ptrdiff_t>(active.size()), from);
    select(order);
    inactive.erase(found);
    active.push_back(back);
  }

  void forget(Eigen::Index row, const Eigen::Vector3d& sigma) {
    P.middleRows<3>(row).setZero();
    P.middleCols<3>(row).setZero();
    P.diagonal().segment<3>(row) = sigma.cwiseAbs2();
  }

  void loosen(const Matrix6d& noise) {
    Eigen::MatrixXd G = Eigen::MatrixXd::Zero(P.rows(), 6);
    G.topRows<6>().setIdentity();
    for (std::size_t i = 0; i < active.size(); ++i) {
      if (!active[i].anchored) G.block<3, 3>(offset(i), 0).setIdentity();
    }
    P += G * noise * G.transpose();
  }
};

} // namespace vi_ekf_slam::test

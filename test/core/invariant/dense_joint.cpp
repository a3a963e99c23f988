#include "dense_joint.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

#include "vi_ekf_slam/core/invariant/inverse_depth.hpp"

namespace vi_ekf_slam::test {

void DenseJoint::transform(const Eigen::MatrixXd& F) { P = (F * P * F.transpose()).eval(); }

void DenseJoint::addNoise(const Eigen::MatrixXd& G, const Eigen::MatrixXd& Q) { P += G * Q * G.transpose(); }

void DenseJoint::propagate(double dt, const ProcessNoise& noise) {
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
  addNoise(G, Q / 3.0);
  addNoise(T, Q);
  const Eigen::MatrixXd cross = G * (Q / 2.0) * T.transpose();
  P += cross + cross.transpose();
  P.diagonal().segment<6>(kBias) += dt * noise.bias_density.cwiseAbs2();
  pose = (pose * SE3::Exp(dt * twist)).normalized();
}

void DenseJoint::update(const Eigen::MatrixXd& H, const Eigen::MatrixXd& R, const Eigen::VectorXd& innovation,
                        const SE3* cam_T_imu) {
  const Eigen::MatrixXd PHt = P * H.transpose(), S = H * PHt + R;
  const Eigen::MatrixXd K = S.llt().solve(PHt.transpose()).transpose();
  transform(identity() - K * H);
  addNoise(K, R);
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

void DenseJoint::addLandmark(FeatureId id, const Eigen::Vector3d& position, const Eigen::Matrix3d& noise) {
  const Eigen::Index n = P.rows(), at = offset(active.size());
  Eigen::MatrixXd F = Eigen::MatrixXd::Zero(n + 3, n);
  F.topLeftCorner(at, at).setIdentity();
  F.block<3, 3>(at, kPosition).setIdentity();
  F.bottomRightCorner(n - at, n - at).setIdentity();
  transform(F);
  P.block<3, 3>(at, at) += noise;
  active.push_back({id, position});
}

void DenseJoint::select(const std::vector<Eigen::Index>& offsets) {
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

std::vector<Eigen::Index> DenseJoint::offsets() const {
  std::vector<Eigen::Index> all;
  for (std::size_t i = 0; i < active.size() + inactive.size(); ++i) all.push_back(offset(i));
  return all;
}

void DenseJoint::removeActive(std::size_t index) {
  std::vector<Eigen::Index> kept = offsets();
  kept[index] = kept[active.size() - 1];
  kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(active.size()) - 1);
  select(kept);
  active[index] = active.back();
  active.pop_back();
}

void DenseJoint::removeInactive(std::size_t index) {
  std::vector<Eigen::Index> kept = offsets();
  kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(active.size() + index));
  select(kept);
  inactive.erase(inactive.begin() + static_cast<std::ptrdiff_t>(index));
}

void DenseJoint::deactivate(std::size_t index, const Eigen::Matrix3d& slid) {
  const Landmark gone = active[index];
  Eigen::MatrixXd F = identity();
  F.block<3, 3>(offset(index), kRotation) = -so3::hat(gone.position);
  transform(F);
  P.block<3, 3>(offset(index), offset(index)) += slid;
  std::vector<Eigen::Index> order = offsets();
  order.push_back(order[index]);
  order[index] = order[active.size() - 1];
  order.erase(order.begin() + static_cast<std::ptrdiff_t>(active.size()) - 1);
  select(order);
  active[index] = active.back();
  active.pop_back();
  inactive.push_back(gone);
}

void DenseJoint::activate(FeatureId id) {
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

void DenseJoint::forget(Eigen::Index row, const Eigen::Vector3d& sigma) {
  P.middleRows<3>(row).setZero();
  P.middleCols<3>(row).setZero();
  P.diagonal().segment<3>(row) = sigma.cwiseAbs2();
}

void DenseJoint::loosen(const Matrix6d& noise) {
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(P.rows(), 6);
  G.topRows<6>().setIdentity();
  for (std::size_t i = 0; i < active.size(); ++i) {
    if (active[i].anchored)
      G.block<3, 3>(offset(i), kRotation) = so3::hat(active[i].position);
    else
      G.block<3, 3>(offset(i), kPosition).setIdentity();
  }
  addNoise(G, noise);
}

} // namespace vi_ekf_slam::test

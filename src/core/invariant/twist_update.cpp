#include "vi_ekf_slam/core/invariant/twist_update.hpp"

#include <utility>

namespace vi_ekf_slam::invariant {

void measureTwist(State& state, Eigen::Index axis, const Eigen::Vector3d& measured,
                  const Eigen::Matrix3d& noise) {
  const Eigen::Index twist = kTwist + axis, bias = kBias + axis;
  const auto P = state.covariance();
  PooledMatrix PHt = P.middleCols<3>(twist) + P.middleCols<3>(bias);
  const Eigen::Matrix3d S = PHt.middleRows<3>(twist) + PHt.middleRows<3>(bias) + noise;
  const Eigen::Vector3d innovation =
      measured - state.twist().segment<3>(axis) - state.bias().segment<3>(axis);
  SparseRows H(3);
  H.add(0, twist, Eigen::Matrix3d::Identity());
  H.add(0, bias, Eigen::Matrix3d::Identity());
  state.apply(Correction(std::move(PHt), S, innovation, std::move(H)));
}

void measureStandstill(State& state, const Vector6d& sigma) {
  PooledMatrix PHt = state.covariance().middleCols<6>(kTwist);
  Matrix6d S = PHt.middleRows<6>(kTwist);
  S.diagonal() += sigma.cwiseAbs2();
  SparseRows H(6);
  for (const Eigen::Index axis : {0, 3}) H.add(axis, kTwist + axis, Eigen::Matrix3d::Identity());
  state.apply(Correction(std::move(PHt), S, -state.twist(), std::move(H)));
}

} // namespace vi_ekf_slam::invariant

#include "vi_ekf_slam/core/invariant/twist_update.hpp"

#include <utility>

namespace vi_ekf_slam::invariant {

void measureTwist(State& state, Eigen::Index axis, const Eigen::Vector3d& measured,
                  const Eigen::Matrix3d& noise) {
  const Eigen::Index twist = kTwist + axis, bias = kBias + axis;
  const auto P = state.covariance();
  Eigen::MatrixXd PHt = P.middleCols<3>(twist) + P.middleCols<3>(bias);
  const Eigen::Matrix3d S = PHt.middleRows<3>(twist) + PHt.middleRows<3>(bias) + noise;
  const Eigen::Vector3d innovation =
      measured - state.twist().segment<3>(axis) - state.bias().segment<3>(axis);
  state.apply(Correction(std::move(PHt), S, innovation));
}

void measureStandstill(State& state, const Vector6d& sigma) {
  Eigen::MatrixXd PHt = state.covariance().middleCols<6>(kTwist);
  Matrix6d S = PHt.middleRows<6>(kTwist);
  S.diagonal() += sigma.cwiseAbs2();
  state.apply(Correction(std::move(PHt), S, -state.twist()));
}

} // namespace vi_ekf_slam::invariant

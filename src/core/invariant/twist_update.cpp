#include "vi_ekf_slam/core/invariant/twist_update.hpp"

#include <utility>

namespace vi_ekf_slam::invariant {

void measureTwist(State& state, Eigen::Index axis, const Eigen::Vector3d& measured,
                  const Eigen::Matrix3d& noise) {
  const Eigen::Index twist = kTwist + axis, bias = kBias + axis;
  const auto P = state.covariance();
  Eigen::MatrixXd HP = P.middleRows<3>(twist) + P.middleRows<3>(bias);
  const Eigen::Matrix3d S = HP.middleCols<3>(twist) + HP.middleCols<3>(bias) + noise;
  const Eigen::Vector3d innovation =
      measured - state.twist().segment<3>(axis) - state.bias().segment<3>(axis);
  state.correct(std::move(HP), S, innovation);
}

void measureStandstill(State& state, const Vector6d& sigma) {
  Eigen::MatrixXd HP = state.covariance().middleRows<6>(kTwist);
  Matrix6d S = HP.middleCols<6>(kTwist);
  S.diagonal() += sigma.cwiseAbs2();
  state.correct(std::move(HP), S, -state.twist());
}

} // namespace vi_ekf_slam::invariant

#include "vi_ekf_slam/core/paper/inverse_pose.hpp"

namespace vi_ekf_slam::paper {

Matrix6d errorTransition(const Vector6d& twist, double tau) {
  // exp of the curly hat is the adjoint of exp: Barfoot, "State Estimation for Robotics", eq. 7.44.
  return SE3::Exp(-tau * twist).adjoint();
}

void predict(const Vector6d& twist, double tau, const Matrix6d& W, InversePose& pose) {
  pose.imu_T_world = (SE3::Exp(-tau * twist) * pose.imu_T_world).normalized();
  const Matrix6d F = errorTransition(twist, tau);
  const Matrix6d P = F * pose.covariance * F.transpose() + W;
  pose.covariance = 0.5 * (P + P.transpose());
}

double TwistHold::advanceTo(Stamp stamp) {
  const double tau = stamp_ ? secondsBetween(*stamp_, stamp) : 0.0;
  stamp_ = stamp;
  return tau;
}

} // namespace vi_ekf_slam::paper

#include "vi_ekf_slam/core/observation/body_twist.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {
namespace {

// How still a body stands whose engine runs, averaged over a tenth of a second: what is known after a second
// does not depend on how often it is said.
constexpr double kStandstillVelocity = 0.02; // m/s
constexpr double kStandstillRate = 0.002;    // rad/s
constexpr double kStandstillPeriod = 0.1;    // s

} // namespace

LinearMeasurement measureTwist(const Filter& filter, Handle twist, Handle bias, Eigen::Index axis,
                               const Eigen::Vector3d& measured, const Eigen::Matrix3d& noise) {
  const auto& variables = filter.variables();
  const Eigen::Vector3d expected =
      variables.mean(twist).segment<3>(axis) + variables.mean(bias).segment<3>(axis);
  return LinearMeasurement(measured - expected, noise)
      .by(filter.rowOf(twist) + axis, Eigen::Matrix3d::Identity())
      .by(filter.rowOf(bias) + axis, Eigen::Matrix3d::Identity());
}

/// The robust kernel of Geman and McClure beyond the gate: the farther off, the less it moves the state. With
/// weight left to what is n times as far, wheels that slip for seconds would drag it along.
bool correctByVelocity(Filter& filter, const LinearMeasurement& velocity) {
  Eigen::Matrix3d S = velocity.noise();
  for (const LinearMeasurement::Term& a : velocity) {
    for (const LinearMeasurement::Term& b : velocity)
      S += a.H * filter.covariance().block(a.column, b.column, a.H.cols(), b.H.cols()) * b.H.transpose();
  }
  const double excess = squaredMahalanobis(Eigen::Vector3d(velocity.residual()), S) / kContradicts;
  if (!(excess > 1.0)) {
    filter.correct(velocity);
    return true;
  }
  LinearMeasurement doubted = velocity;
  doubted.addNoise((excess * excess - 1.0) * S);
  filter.correct(doubted);
  return false;
}

Matrix6d standstillNoise(double dt) {
  return kStandstillPeriod / std::max(dt, 1e-3) * independentPose(kStandstillVelocity, kStandstillRate);
}

LinearMeasurement measureStandstill(const Filter& filter, Handle twist, double dt) {
  return LinearMeasurement(-filter.variables().mean(twist), standstillNoise(dt))
      .by(filter.rowOf(twist), Matrix6d::Identity());
}

} // namespace vi_ekf_slam

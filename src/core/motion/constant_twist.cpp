#include "vi_ekf_slam/core/motion/constant_twist.hpp"

#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/observation/body_twist.hpp"

namespace vi_ekf_slam {

void ConstantTwist::addTo(Filter& filter) {
  twist_ = filter.augment(Chart::kVector, Vector6d::Zero(),
                          options_.prior_twist_sigma.cwiseAbs2().asDiagonal().toDenseMatrix(), {}, kTwist);
  bias_ = filter.augment(Chart::kVector, prior_bias_,
                         options_.prior_bias_sigma.cwiseAbs2().asDiagonal().toDenseMatrix(), {}, kBias);
}

void ConstantTwist::setBiasPrior(Filter& filter, const TwistBias& bias) {
  prior_bias_ = bias.mean;
  is_bias_told_ = true;
  options_.prior_bias_sigma = bias.sigma;
  resetBiases(filter);
}

void ConstantTwist::setOpticalBody() {
  if (std::exchange(is_optical_, true)) return;
  const auto turn = [](Vector6d& of_vehicle) {
    const Vector6d v = of_vehicle;
    of_vehicle << v[1], v[2], v[0], v[4], v[5], v[3];
  };
  for (Vector6d* v : {&options_.twist_density, &options_.bias_density, &options_.prior_twist_sigma}) turn(*v);
  if (!is_bias_told_) turn(options_.prior_bias_sigma); // else it is along the sensor's axes
}

SE3 ConstantTwist::startPose() const {
  if (!is_optical_) return {};
  Eigen::Matrix3d vehicle_R_optical;
  vehicle_R_optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return {vehicle_R_optical, Eigen::Vector3d::Zero()};
}

/// T' = T Exp(dt nu). The right-invariant error about the body's old position gains B dnu with
/// B = dt Ad(R) J_l(dt nu), of the mean error of the twist over the step; about its new one dp' = dp -
/// [p' - p]x theta'. White noise of density Q on the twist's derivative leaves Q dt on the twist, Q dt / 3 on
/// its mean over the step and Q dt / 2 between the two.
void ConstantTwist::propagate(Filter& filter, double dt) const {
  const SE3& pose = filter.pose();
  const Vector6d nu = filter.variables().mean(twist_);
  CoreStep step;
  step.pose = (pose * SE3::Exp(dt * nu)).normalized();
  Matrix6d moved = Matrix6d::Identity();
  moved.topRightCorner<3, 3>() = -so3::hat(step.pose.translation() - pose.translation());
  const Matrix6d turned = SE3(pose.rotation(), Eigen::Vector3d::Zero()).adjoint();
  const Matrix6d B = moved * (dt * turned * se3::leftJacobian(dt * nu));
  const Eigen::Index t = filter.rowOf(twist_), b = filter.rowOf(bias_);
  step.F.setZero(6, t + 6);
  step.F.leftCols<6>() = moved;
  step.F.middleCols<6>(t) = B;
  const Vector6d Q = dt * options_.twist_density.cwiseAbs2();
  step.Q.setZero(b + 6, b + 6);
  step.Q.topLeftCorner<6, 6>() = B * (Q / 3.0).asDiagonal() * B.transpose();
  step.Q.block<6, 6>(0, t) = B * (0.5 * Q).asDiagonal();
  step.Q.block<6, 6>(t, 0) = step.Q.block<6, 6>(0, t).transpose();
  step.Q.block<6, 6>(t, t).diagonal() = Q;
  step.Q.block<6, 6>(b, b).diagonal() = dt * options_.bias_density.cwiseAbs2();
  filter.propagate(step);
}

void ConstantTwist::process(Filter& filter, const ImuSample& sample) const {
  filter.correct(measureTwist(filter, twist_, bias_, 3, sample.angular_velocity, noiseOf(sample)));
}

LinearMeasurement ConstantTwist::measure(const Filter& filter, const VelocitySample& sample) const {
  return measureTwist(filter, twist_, bias_, 0, sample.linear_velocity, noiseOf(sample));
}

Eigen::Matrix3d ConstantTwist::noiseOf(const ImuSample& sample) const {
  return sample.covariance.value_or(isotropic(options_.gyro_sigma));
}

Eigen::Matrix3d ConstantTwist::noiseOf(const VelocitySample& sample) const {
  return sample.covariance.value_or(isotropic(options_.velocity_sigma));
}

void ConstantTwist::processStandstill(Filter& filter, const ImuTrack& /*imu*/, Stamp /*now*/,
                                      double dt) const {
  filter.correct(measureStandstill(filter, twist_, dt));
}

void ConstantTwist::reset(Filter& filter, bool biases, const TwistNoise& sampled) const {
  Matrix6d P = options_.prior_twist_sigma.cwiseAbs2().asDiagonal();
  const auto measured = [&](Eigen::Index axis, const std::optional<Eigen::Matrix3d>& noise) {
    if (!noise) return;
    P.block<3, 3>(axis, axis) = *noise;
    P.block<3, 3>(axis, axis) += options_.prior_bias_sigma.segment<3>(axis).cwiseAbs2().asDiagonal();
  };
  measured(0, sampled.velocity);
  measured(3, sampled.gyro);
  filter.makeIndependent(filter.rowOf(twist_), P);
  if (biases) resetBiases(filter);
}

void ConstantTwist::resetBiases(Filter& filter) const {
  filter.setMean(bias_, prior_bias_);
  filter.makeIndependent(filter.rowOf(bias_),
                         options_.prior_bias_sigma.cwiseAbs2().asDiagonal().toDenseMatrix());
}

Eigen::Matrix3d ConstantTwist::gyroBiasCovariance(const Filter& filter) const {
  return filter.covariance(bias_).bottomRightCorner<3, 3>();
}

double ConstantTwist::twistChange(const Filter& filter, const Eigen::VectorXd& error) const {
  return squaredMahalanobis(Vector6d(error.segment<6>(filter.rowOf(twist_))),
                            Matrix6d(filter.covariance(twist_)));
}

} // namespace vi_ekf_slam

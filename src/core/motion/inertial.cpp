#include "vi_ekf_slam/core/motion/inertial.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/core/observation/body_twist.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kStandingSpeed = 0.15; // m/s, that what stands may seem to move with

using Matrix9x3 = Eigen::Matrix<double, 9, 3>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Vector9d = Eigen::Matrix<double, 9, 1>;

Matrix9d scaleCovariance(double sigma) { return sigma * sigma * Matrix9d::Identity(); }

} // namespace

void Inertial::addTo(Filter& filter) {
  velocity_ = filter.augment(Chart::kWorldVector, Eigen::Vector3d::Zero(), isotropic(options_.velocity_sigma),
                             {}, kVelocity);
  gyro_bias_ = filter.augment(Chart::kBodyVector, prior_gyro_bias_, isotropic(options_.gyro_bias_sigma), {},
                              kGyroBias);
  accelerometer_bias_ = filter.augment(Chart::kBodyVector, Eigen::Vector3d::Zero(),
                                       isotropic(options_.accelerometer_bias_sigma), {}, kAccelerometerBias);
  accelerometer_scale_.reset();
  if (options_.accelerometer_scale_sigma > 0.0)
    accelerometer_scale_ =
        filter.augment(Chart::kBodyVector, Vector9d::Zero(),
                       scaleCovariance(options_.accelerometer_scale_sigma), {}, kAccelerometerScale);
}

std::vector<std::string> Inertial::variables() const {
  std::vector<std::string> names{kVelocity, kGyroBias, kAccelerometerBias};
  if (options_.accelerometer_scale_sigma > 0.0) names.emplace_back(kAccelerometerScale);
  return names;
}

/// From v = v^ + dv to v = Exp(theta) (v^ + e): e = dv + [v^]x theta.
bool Inertial::begin(Filter& filter, const InitialState& state) const {
  const Eigen::Index rows = filter.coreRows(), v = filter.rowOf(velocity_);
  filter.begin(state.world_T_imu);
  filter.setMean(velocity_, state.velocity);
  filter.setMean(gyro_bias_, state.gyro_bias);
  filter.setMean(accelerometer_bias_, state.accelerometer_bias);
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(rows, 15);
  J.topRows<6>().leftCols<6>().setIdentity();
  J.block<9, 9>(v, 6).setIdentity();
  J.block<3, 3>(v, 3) = so3::hat(state.velocity);
  Eigen::MatrixXd P = filter.covariance();
  const Eigen::MatrixXd JP = J * state.covariance;
  const Eigen::MatrixXd own = JP * J.transpose();
  P.topLeftCorner(v + 9, v + 9) = own.topLeftCorner(v + 9, v + 9);
  filter.setCoreCovariance(0.5 * (P + P.transpose()));
  return true;
}

void Inertial::setBiasPrior(Filter& filter, const TwistBias& bias) {
  prior_gyro_bias_ = bias.mean.tail<3>();
  options_.gyro_bias_sigma = bias.sigma.tail<3>().maxCoeff();
  resetBiases(filter);
}

/// Over a step the error becomes, exactly but for the biases' (docs/architecture.md, "Motion: inertial"),
///
///   theta' = theta - B db_g,   e_v' = e_v + [g]x theta dt - (R D1 dt^2 + [v']x B) db_g - R G1 dt db_a,
///   dp' = dp + ([g]x dt^2 / 2 - [p' - p]x) theta + e_v dt - R D2 dt^3 db_g - R G2 dt^2 db_a
///
/// with B = R J_l(w dt) dt and D_k the derivative of G_k(w dt) a by w dt, to first order in it. White noise
/// of the IMU enters as an error of its bias does. Of M = [m_1 m_2 m_3] the sum of a_mk dm_k is too much.
void Inertial::propagate(Filter& filter, const ImuTrack& imu, Stamp from, Stamp to) const {
  const double dt = secondsBetween(from, to);
  const ImuInterval input = imu.over(from, to);
  const Eigen::Matrix3d& R = filter.pose().rotation();
  const Eigen::Vector3d v = filter.variables().mean(velocity_);
  const Eigen::Vector3d mean_rate = input.rate - gyroBias(filter);
  const Eigen::Matrix3d C = unscaling(filter);
  const Eigen::Vector3d force = C * input.acceleration - accelerometerBias(filter);
  const Eigen::Vector3d more = C * input.acceleration_change;
  // Of what changes over the step: coning and sculling, and the shorter way of a force that comes late.
  const Eigen::Vector3d w = mean_rate + dt / 12.0 * mean_rate.cross(input.rate_change);
  const Eigen::Vector3d a = force + dt / 12.0 * (mean_rate.cross(more) - input.rate_change.cross(force));
  const Eigen::Vector3d g(0.0, 0.0, -options_.gravity), phi = dt * w;
  const Eigen::Matrix3d G1 = so3::leftJacobian(phi), G2 = so3::secondIntegral(phi);
  const Eigen::Vector3d gained = dt * (R * (G1 * a) + g);
  const Eigen::Vector3d moved = dt * v + dt * dt * (R * (G2 * a - more / 12.0) + 0.5 * g);

  const Eigen::Matrix3d A = so3::hat(a), W = so3::hat(phi), WA = so3::hat(w.cross(a) * dt);
  const Eigen::Matrix3d D1 = -0.5 * A - (WA + W * A) / 6.0, D2 = -A / 6.0 - (WA + W * A) / 24.0;
  const Eigen::Matrix3d B = dt * R * G1;
  Matrix9x3 by_gyro, by_force; // rows dp, theta, e_v, by what is too much of w and a
  by_gyro << -dt * dt * dt * R * D2, -B, -dt * dt * R * D1 - so3::hat(v + gained) * B;
  by_force << -dt * dt * R * G2, Eigen::Matrix3d::Zero(), -B;

  const Eigen::Index row = filter.rowOf(velocity_), bg = filter.rowOf(gyro_bias_),
                     ba = filter.rowOf(accelerometer_bias_);
  CoreStep step;
  step.pose = SE3(so3::normalized(R * so3::Exp(phi)), filter.pose().translation() + moved);
  step.means = {{velocity_, v + gained}};
  step.F.setZero(row + 3, ba + 3 + (accelerometer_scale_ ? 9 : 0));
  step.F.leftCols(row + 3).setIdentity();
  step.F.block<3, 3>(0, 3) = 0.5 * dt * dt * so3::hat(g) - so3::hat(moved);
  step.F.block<3, 3>(0, row) = dt * Eigen::Matrix3d::Identity();
  step.F.block<3, 3>(row, 3) = dt * so3::hat(g);
  step.F.block<9, 3>(0, bg) = by_gyro;
  step.F.block<9, 3>(0, ba) = by_force;
  for (Eigen::Index k = 0; accelerometer_scale_ && k < 3; ++k)
    step.F.block<9, 3>(0, filter.rowOf(*accelerometer_scale_) + 3 * k) = input.acceleration[k] * by_force;
  step.Q.setZero(ba + 3, ba + 3);
  step.Q.topLeftCorner<9, 9>() = (by_gyro * input.rate_density * by_gyro.transpose() +
                                  by_force * input.acceleration_density * by_force.transpose()) /
                                 dt;
  step.Q.block<3, 3>(bg, bg) = dt * isotropic(options_.noise.gyro_walk);
  step.Q.block<3, 3>(ba, ba) = dt * isotropic(options_.noise.accelerometer_walk);
  filter.propagate(step);
}

/// R^T v of the truth is R^T (v^ + e).
LinearMeasurement Inertial::measure(const Filter& filter, const VelocitySample& sample) const {
  const Eigen::Matrix3d body_R_world = filter.pose().rotation().transpose();
  return LinearMeasurement(sample.linear_velocity - body_R_world * filter.variables().mean(velocity_),
                           noiseOf(sample))
      .by(filter.rowOf(velocity_), body_R_world);
}

Eigen::Matrix3d Inertial::noiseOf(const ImuSample& sample, const ImuTrack& imu) const {
  return imu.gyroNoise(sample);
}

Eigen::Matrix3d Inertial::noiseOf(const VelocitySample& sample) const {
  return sample.covariance.value_or(isotropic(options_.measured_velocity_sigma));
}

void Inertial::processStandstill(Filter& filter, const ImuTrack& imu, Stamp now, double dt) const {
  Matrix6d noise = standstillNoise(dt);
  noise.bottomRightCorner<3, 3>() += imu.gyroNoise(); // the rate is that of one sample
  Vector6d residual;
  residual << -filter.variables().mean(velocity_), imu.rateAt(now) - gyroBias(filter); // 0 = w_m - b_g - n
  Eigen::Matrix<double, 6, 3> by_velocity = Eigen::Matrix<double, 6, 3>::Zero(), by_bias = by_velocity;
  by_velocity.topRows<3>().setIdentity();
  by_bias.bottomRows<3>().setIdentity();
  filter.correct(LinearMeasurement(residual, noise)
                     .by(filter.rowOf(velocity_), by_velocity)
                     .by(filter.rowOf(gyro_bias_), by_bias));
}

bool Inertial::mayStand(const Filter& filter) const {
  const double variance = filter.covariance(velocity_).trace();
  return filter.variables().mean(velocity_).norm() <= kStandingSpeed + 3.0 * std::sqrt(variance);
}

void Inertial::reset(Filter& filter, bool biases, const TwistNoise& sampled) const {
  Eigen::Matrix3d P = isotropic(options_.velocity_sigma);
  if (sampled.velocity) {
    const Eigen::Matrix3d& R = filter.pose().rotation();
    P = R * *sampled.velocity * R.transpose();
  }
  filter.makeIndependent(filter.rowOf(velocity_), P);
  if (biases) resetBiases(filter);
}

void Inertial::resetBiases(Filter& filter) const {
  filter.setMean(gyro_bias_, prior_gyro_bias_);
  filter.makeIndependent(filter.rowOf(gyro_bias_), isotropic(options_.gyro_bias_sigma));
  filter.setMean(accelerometer_bias_, Eigen::Vector3d::Zero());
  filter.makeIndependent(filter.rowOf(accelerometer_bias_), isotropic(options_.accelerometer_bias_sigma));
  if (!accelerometer_scale_) return;
  filter.setMean(*accelerometer_scale_, Vector9d::Zero());
  filter.makeIndependent(filter.rowOf(*accelerometer_scale_),
                         scaleCovariance(options_.accelerometer_scale_sigma));
}

Eigen::Matrix3d Inertial::unscaling(const Filter& filter) const {
  if (!accelerometer_scale_) return Eigen::Matrix3d::Identity();
  const Vector9d M = filter.variables().mean(*accelerometer_scale_);
  return Eigen::Matrix3d::Identity() - Eigen::Map<const Eigen::Matrix3d>(M.data());
}

Vector6d Inertial::twist(const Filter& filter, const ImuTrack& imu, Stamp now) const {
  Vector6d twist;
  twist << filter.pose().rotation().transpose() * filter.variables().mean(velocity_),
      imu.rateAt(now) - gyroBias(filter);
  return twist;
}

Matrix6d Inertial::twistCovariance(const Filter& filter, const ImuTrack& imu) const {
  const Eigen::Matrix3d body_R_world = filter.pose().rotation().transpose();
  Matrix6d P = Matrix6d::Zero();
  const Eigen::Matrix3d cross = -body_R_world * filter.covariance(velocity_, gyro_bias_);
  P << body_R_world * filter.covariance(velocity_) * body_R_world.transpose(), cross, cross.transpose(),
      filter.covariance(gyro_bias_) + imu.gyroNoise();
  return P;
}

Vector6d Inertial::bias(const Filter& filter) const {
  Vector6d bias;
  bias << Eigen::Vector3d::Zero(), filter.variables().mean(gyro_bias_);
  return bias;
}

Eigen::Vector3d Inertial::accelerometerBias(const Filter& filter) const {
  return filter.variables().mean(accelerometer_bias_);
}

Eigen::Matrix3d Inertial::gyroBiasCovariance(const Filter& filter) const {
  return filter.covariance(gyro_bias_);
}

double Inertial::twistChange(const Filter& filter, const Eigen::VectorXd& error) const {
  const Eigen::Index row = filter.rowOf(velocity_);
  return squaredMahalanobis(Vector6d(error.segment<6>(row)),
                            Matrix6d(filter.covariance().block<6, 6>(row, row)));
}

} // namespace vi_ekf_slam

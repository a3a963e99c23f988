#include "vi_ekf_slam/simulation/inertial/told_truth.hpp"

#include <cstddef>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {
namespace {

using Vector15d = Eigen::Matrix<double, 15, 1>;
using Errors = Eigen::Matrix<double, 8, 1>;

Errors errorsOf(const StereoRig& truth, double true_offset, const StereoRig& rig, double offset) {
  Errors e;
  e << so3::Log(truth.cam_T_imu.rotation() * rig.cam_T_imu.rotation().transpose()),
      truth.cam_T_imu.translation() - rig.cam_T_imu.translation(), true_offset - offset,
      (truth.camera.baseline - rig.camera.baseline) / truth.camera.baseline;
  return e;
}

} // namespace

Config toldTheTruth(Config config, const DriveOptions& options) {
  InvariantConfig& filter = config.invariant;
  filter.choice = MotionChoice::kInertial;
  filter.inertial.noise = {options.gyro_density, options.accelerometer_density, options.gyro_walk,
                           options.accelerometer_walk};
  filter.inertial.noise_given = true;
  filter.inertial.accelerometer_scale_sigma = options.accelerometer_scale_sigma;
  if (options.accelerometer_bias_sigma > 0.0)
    filter.inertial.accelerometer_bias_sigma = options.accelerometer_bias_sigma;
  if (options.gyro_bias_sigma > 0.0) filter.inertial.gyro_bias_sigma = options.gyro_bias_sigma;
  filter.inertial.gravity = kGravity;
  if (options.pixel_sigma > 0.0) filter.stereo.pixel_sigma = options.pixel_sigma;
  filter.slip.sigma = 0.0;
  return config;
}

InitialState drawnStart(const TrueState& truth, std::uint64_t seed) {
  Vector15d sigma;
  sigma << Eigen::Vector3d::Constant(1e-4), 1e-3, 1e-3, 1e-4, Eigen::Vector3d::Constant(1e-2),
      Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(1e-2);
  Random random(seed, RandomStream::kStart);
  Vector15d error;
  for (Eigen::Index i = 0; i < error.size(); ++i) error[i] = sigma[i] * random.normal();
  InitialState state;
  state.stamp = truth.stamp;
  state.world_T_imu = SE3(so3::Exp(-error.segment<3>(3)) * truth.world_T_imu.rotation(),
                          truth.world_T_imu.translation() - error.head<3>());
  state.velocity = truth.velocity - error.segment<3>(6);
  state.gyro_bias = truth.gyro_bias - error.segment<3>(9);
  state.accelerometer_bias = truth.accelerometer_bias - error.tail<3>();
  state.covariance = sigma.cwiseAbs2().asDiagonal();
  return state;
}

SE3 mapOfTruth(const SE3& truth, const SE3& estimate) { return levelled(estimate, truth) * truth.inverse(); }

ToldRig::ToldRig(std::uint64_t seed, const StereoRig& truth, const RigDisturbance& disturbance)
    : truth_(truth), told_(truth) {
  Random random(seed, RandomStream::kRig);
  const Eigen::Vector3d axis = random.normal3().normalized(), way = random.normal3().normalized();
  told_.cam_T_imu = SE3(so3::Exp(disturbance.rotation * axis) * truth.cam_T_imu.rotation(),
                        truth.cam_T_imu.translation() + disturbance.translation * way);
  time_offset_ = random.sign() * disturbance.time_offset;
  told_.camera.baseline *= 1.0 + random.sign() * disturbance.scale;
}

std::array<InertialOutcome::RigPart, 8> ToldRig::judge(const RigEstimate& e) const {
  const Errors before = errorsOf(truth_, time_offset_, told_, 0.0);
  const Errors after = errorsOf(truth_, time_offset_, e.rig, e.time_offset);
  Errors sigma;
  sigma << e.rotation_sigma, e.translation_sigma, e.time_offset_sigma,
      e.baseline_sigma / truth_.camera.baseline;
  std::array<InertialOutcome::RigPart, 8> parts;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    parts[i] = {before[row], after[row], sigma[row]};
  }
  return parts;
}

} // namespace vi_ekf_slam::simulation

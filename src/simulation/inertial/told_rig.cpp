#include "vi_ekf_slam/simulation/inertial/told_rig.hpp"

#include <cstddef>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {
namespace {

using Errors = Eigen::Matrix<double, 8, 1>;

Errors errorsOf(const StereoRig& truth, double true_offset, const StereoRig& rig, double offset) {
  Errors e;
  e << so3::Log(truth.cam_T_imu.rotation() * rig.cam_T_imu.rotation().transpose()),
      truth.cam_T_imu.translation() - rig.cam_T_imu.translation(), true_offset - offset,
      (truth.camera.baseline - rig.camera.baseline) / truth.camera.baseline;
  return e;
}

} // namespace

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

#include "vi_ekf_slam/core/paper/models.hpp"

#include <cmath>
#include <cstdint>
#include <limits>

namespace vi_ekf_slam::paper {

Matrix6d errorTransition(const Vector6d& twist, double tau) {
  // exp of the curly hat is the adjoint of exp: Barfoot, "State Estimation for Robotics", eq. 7.44.
  return SE3::Exp(-tau * twist).adjoint();
}

void predict(const Vector6d& twist, double tau, const Matrix6d& W, SE3& imu_T_world,
             Eigen::Ref<Matrix6d> covariance) {
  imu_T_world = (SE3::Exp(-tau * twist) * imu_T_world).normalized();
  const Matrix6d F = errorTransition(twist, tau);
  const Matrix6d P = F * covariance * F.transpose() + W;
  covariance = 0.5 * (P + P.transpose());
}

bool isPlausible(const StereoPixels& pixels) {
  constexpr double kMaxPixel = 1e6; // no image is that wide, and the square of one far beyond it overflows
  return (pixels.array().abs() <= kMaxPixel).all(); // false for what is not a number, too
}

std::optional<PredictedObservation> predictObservation(const StereoRig& rig, const SE3& imu_T_world,
                                                       const Eigen::Vector3d& landmark_world,
                                                       double min_depth_m) {
  const Eigen::Vector3d p_imu = imu_T_world * landmark_world;
  const Eigen::Vector3d p_cam = rig.cam_T_imu * p_imu;
  if (!(p_cam.z() >= min_depth_m)) return std::nullopt;
  const Eigen::Matrix<double, 4, 3> by_imu_point =
      rig.camera.projectJacobian(p_cam) * rig.cam_T_imu.rotation();
  PredictedObservation prediction;
  prediction.pixels = rig.camera.project(p_cam);
  prediction.by_landmark = by_imu_point * imu_T_world.rotation();
  prediction.by_pose = by_imu_point * se3::pointJacobian(p_imu);
  return prediction;
}

std::optional<Eigen::Vector3d> initialLandmark(const StereoRig& rig, const SE3& imu_T_world,
                                               const StereoPixels& pixels, const PaperConfig& config) {
  const auto p_cam = rig.camera.triangulate(pixels);
  if (!p_cam || p_cam->z() < config.min_depth_m || p_cam->z() > config.max_depth_m) return std::nullopt;
  return (rig.cam_T_imu * imu_T_world).inverse() * *p_cam;
}

bool isSelected(FeatureId id, double fraction) {
  if (fraction >= 1.0) return true;
  // The fractional part of id * fraction in units of 2^-64: the product's overflow takes the whole turns
  // away, exactly for ids of any size. An id is in when the next one begins another turn.
  const auto step = static_cast<std::uint64_t>(std::ldexp(fraction, 64));
  return id * step > std::numeric_limits<std::uint64_t>::max() - step;
}

} // namespace vi_ekf_slam::paper

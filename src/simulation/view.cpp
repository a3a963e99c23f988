#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/simulation/scene.hpp"

namespace vi_ekf_slam::simulation {

bool View::contains(const StereoPixels& z) const {
  return std::min(z[0], z[2]) >= margin && std::max(z[0], z[2]) <= width - margin &&
         std::min(z[1], z[3]) >= margin && std::max(z[1], z[3]) <= height - margin;
}

bool View::sees(const Eigen::Vector3d& p_cam) const {
  return p_cam.z() >= min_depth && p_cam.z() <= max_depth && contains(rig.camera.project(p_cam));
}

View makeView(const DriveOptions& options) {
  View view;
  view.margin = 1.0 + 6.0 * options.pixel_sigma;
  view.min_depth = options.min_depth;
  view.max_depth = options.max_depth;
  Eigen::Matrix3d imu_R_optical; // columns: right, down, forward in IMU axes (x forward, y left, z up)
  imu_R_optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  if (options.motion == MotionModel::kHandheld) {
    view.rig.camera = {458.0, 458.0, 376.0, 240.0, 0.11};
    view.width = 752.0;
    view.height = 480.0;
    const Eigen::Matrix3d misalignment = so3::Exp({0.01, 0.02, -0.015});
    view.rig.cam_T_imu = SE3(misalignment * imu_R_optical, {0.05, 0.055, -0.02}).inverse();
    return view;
  }
  view.rig.camera = {707.0912, 707.0912, 601.8873, 183.1104, 0.5371506532679237};
  const Eigen::Matrix3d misalignment = so3::Exp({-0.0011, 0.0068, 0.0085});
  const SE3 imu_T_cam(misalignment * imu_R_optical, {1.14, -0.31, 0.73});
  view.rig.cam_T_imu = imu_T_cam.inverse();
  return view;
}

} // namespace vi_ekf_slam::simulation

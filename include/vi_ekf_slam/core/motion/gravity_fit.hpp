#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/imu_track.hpp"

namespace vi_ekf_slam {

/// A pose of the IMU by the pictures, in a frame of theirs.
struct SeenPose {
  Stamp stamp = 0;
  SE3 frame_T_imu;
  Eigen::Vector3d position_sigma = Eigen::Vector3d::Zero(); ///< m, along the frame's axes, above 0
};

/// What the accelerometer says once the pictures say how the IMU moved, along the axes of their frame.
struct GravityFit {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();  ///< m/s^2, of the known length
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero(); ///< m/s, at the first pose
  double free_length = 0.0, free_length_sigma = 0.0;  ///< m/s^2, of gravity where its length is not given
  double tilt_sigma = 0.0;                            ///< rad, standard deviation of its direction
  double misfit = 0.0; ///< RMS of the positions' residuals, in units of their standard deviation
};

/// Linear least squares over poses and IMU samples (both by stamp, samples from the first pose or before it
/// to the last or behind it): p_k - p_0 = v_0 t + g t^2 / 2 + the twice integrated accelerations, of which a
/// bias of standard deviation `bias_sigma` (m/s^2) is a part, and p_0 is wrong in all of them; then with g of
/// the length `gravity`. Nothing with fewer than four poses or where the equations do not tell.
std::optional<GravityFit> fitGravity(const std::vector<SeenPose>& poses,
                                     const std::vector<ImuSample>& samples, const Eigen::Vector3d& gyro_bias,
                                     double bias_sigma, double gravity);

} // namespace vi_ekf_slam

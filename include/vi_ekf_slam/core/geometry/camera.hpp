#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/geometry/se3.hpp"

namespace vi_ekf_slam {

/// Pixels (u_left, v_left, u_right, v_right) of one point in a rectified pair.
using StereoPixels = Eigen::Vector4d;

/// Rectified pair (paper eq. 3 to 7). Points (m) are in the left OPTICAL frame: x right, y down, z forward.
struct StereoCamera {
  double fu = 0.0;       ///< f s_u, px
  double fv = 0.0;       ///< f s_v, px
  double cu = 0.0;       ///< px
  double cv = 0.0;       ///< px
  double baseline = 0.0; ///< m, > 0: the right camera sits at (+baseline, 0, 0)

  /// Whether all values are finite and focal lengths and baseline positive.
  bool isValid() const;

  /// Paper eq. 5. `p` in m with p.z() > 0 (the caller checks).
  StereoPixels project(const Eigen::Vector3d& p) const;

  /// 4x3 derivative of project at `p` (M dpi/dq of paper eq. 14, without the homogeneous column).
  Eigen::Matrix<double, 4, 3> projectJacobian(const Eigen::Vector3d& p) const;

  /// The point in m behind four pixels: depth from the disparity (paper eq. 7, with the sign of eq. 6's third
  /// row repaired), rows averaged. Nothing when the disparity is not positive or a pixel is not finite.
  std::optional<Eigen::Vector3d> triangulate(const StereoPixels& z) const;

  /// 3x4 derivative of triangulate at the pixels `z`, whose disparity must be positive.
  Eigen::Matrix<double, 3, 4> triangulateJacobian(const StereoPixels& z) const;
};

/// A stereo pair and where it sits: cam_T_imu takes IMU-frame points to the left optical frame.
struct StereoRig {
  StereoCamera camera;
  SE3 cam_T_imu;
};

} // namespace vi_ekf_slam

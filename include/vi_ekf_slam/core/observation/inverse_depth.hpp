#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam {

/// The coordinates (x/z, y/z, 1/z) of a point in the camera frame, in which a rectified pair's pixels are
/// linear (Civera, Davison and Montiel, "Inverse depth parametrization for monocular SLAM", 2008, anchored in
/// the current camera).
struct InverseDepth {
  /// Whether the point (m) is far enough before the camera for the coordinates to make sense, and where a
  /// camera can see it.
  static bool isDefined(const Eigen::Vector3d& q);

  /// 3x3 derivative of the coordinates by the point.
  static Eigen::Matrix3d jacobian(const Eigen::Vector3d& q);

  /// 3x3 derivative of the point by the coordinates: the inverse of jacobian(q).
  static Eigen::Matrix3d pointJacobian(const Eigen::Vector3d& q);

  /// The point whose coordinates are those of `q` plus jacobian(q) * dq. The inverse depth is kept above a
  /// fifth of its value: no single correction sends a point through infinity.
  static Eigen::Vector3d moved(const Eigen::Vector3d& q, const Eigen::Vector3d& dq);
};

} // namespace vi_ekf_slam

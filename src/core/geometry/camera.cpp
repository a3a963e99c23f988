#include "vi_ekf_slam/core/geometry/camera.hpp"

#include <cmath>

namespace vi_ekf_slam {

bool StereoCamera::isValid() const {
  return std::isfinite(fu) && std::isfinite(fv) && std::isfinite(cu) && std::isfinite(cv) &&
         std::isfinite(baseline) && fu > 0.0 && fv > 0.0 && baseline > 0.0;
}

StereoPixels StereoCamera::project(const Eigen::Vector3d& p) const {
  const double u = fu * p.x() / p.z() + cu;
  const double v = fv * p.y() / p.z() + cv;
  return {u, v, u - fu * baseline / p.z(), v};
}

Eigen::Matrix<double, 4, 3> StereoCamera::projectJacobian(const Eigen::Vector3d& p) const {
  const double z2 = p.z() * p.z();
  const Eigen::RowVector3d du(fu / p.z(), 0.0, -fu * p.x() / z2);
  const Eigen::RowVector3d dv(0.0, fv / p.z(), -fv * p.y() / z2);
  Eigen::Matrix<double, 4, 3> J;
  J << du, dv, du + Eigen::RowVector3d(0.0, 0.0, fu * baseline / z2), dv;
  return J;
}

std::optional<Eigen::Vector3d> StereoCamera::triangulate(const StereoPixels& z) const {
  const double disparity = z[0] - z[2];
  if (!z.allFinite() || !(disparity > 0.0)) return std::nullopt;
  const double depth = fu * baseline / disparity;
  const double v = 0.5 * (z[1] + z[3]);
  const Eigen::Vector3d p((z[0] - cu) / fu * depth, (v - cv) / fv * depth, depth);
  if (!p.allFinite()) return std::nullopt;
  return p;
}

Eigen::Matrix<double, 3, 4> StereoCamera::triangulateJacobian(const StereoPixels& z) const {
  const double disparity = z[0] - z[2];
  const double depth = fu * baseline / disparity;
  const double x = (z[0] - cu) / fu, y = (0.5 * (z[1] + z[3]) - cv) / fv;
  const Eigen::RowVector4d ddepth(-depth / disparity, 0.0, depth / disparity, 0.0);
  Eigen::Matrix<double, 3, 4> J;
  J.row(0) = x * ddepth + Eigen::RowVector4d(depth / fu, 0.0, 0.0, 0.0);
  J.row(1) = y * ddepth + Eigen::RowVector4d(0.0, 0.5 * depth / fv, 0.0, 0.5 * depth / fv);
  J.row(2) = ddepth;
  return J;
}

} // namespace vi_ekf_slam

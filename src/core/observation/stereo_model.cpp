#include "vi_ekf_slam/core/observation/stereo_model.hpp"

#include <cmath>

#include "vi_ekf_slam/core/observation/inverse_depth.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kMaxPixel = 1e6; // px; beyond it a coordinate is not one of an image
// In units of the noise of one row, 4 standard deviations of the difference of two: one good feature in
// 16,000 has more.
constexpr double kSameRow = 5.66;

Eigen::Vector3d reduced(const StereoPixels& z) { return {z[0], 0.5 * (z[1] + z[3]), z[2]}; }

} // namespace

bool StereoModel::isUsable(const StereoPixels& pixels) const {
  return pixels.allFinite() && pixels.cwiseAbs().maxCoeff() <= kMaxPixel &&
         pixels[0] - pixels[2] >= options_.min_disparity &&
         std::abs(pixels[1] - pixels[3]) <= kSameRow * options_.pixel_sigma;
}

/// The flow by which a landmark tells the distance d is f(rho) d, weighed by f(rho): a point whose noise puts
/// it too near is predicted with too much flow and has too much weight for it, so that sigma_rho^2 / rho^2 of
/// the distance would be lost on the average. With rho - sigma_rho^2 / rho, the mean under a prior 1 / rho,
/// E[rho (rho d - rho^ d)] is zero to that order. Half of it for each picture: the direction from the middle
/// of the pair is independent of the disparity.
StereoPixels StereoModel::withoutBias(const StereoPixels& pixels) const {
  const double shift = options_.pixel_sigma * options_.pixel_sigma / (pixels[0] - pixels[2]);
  return pixels + StereoPixels(-shift, 0.0, shift, 0.0);
}

/// With the baseline b (1 + s).
StereoCamera StereoModel::cameraOf(const Filter& filter) const {
  StereoCamera camera = rig_.camera;
  if (scale_) camera.baseline *= 1.0 + filter.variables().mean(*scale_)[0];
  return camera;
}

std::optional<LinearMeasurement> StereoModel::observe(const Filter& filter, Handle landmark,
                                                      const StereoPixels& pixels) const {
  const SE3 cam_T_world = camTWorld(filter);
  const StereoCamera camera = cameraOf(filter);
  const Eigen::Vector3d q = cam_T_world * filter.variables().point(landmark);
  if (!(q.z() >= options_.min_depth_m)) return std::nullopt;
  const Eigen::Matrix<double, 4, 3> by_point = camera.projectJacobian(q);
  Eigen::Matrix3d J;
  J << by_point.row(0), by_point.row(1), by_point.row(2);
  LinearMeasurement z(reduced(pixels) - reduced(camera.project(q)), noise());
  z.by(filter.rowOf(landmark), Eigen::Matrix3d(J * cam_T_world.rotation()));
  // u_right = u_left - f b (1 + s) / z
  if (scale_)
    z.by(filter.rowOf(*scale_), Eigen::Vector3d(0.0, 0.0, -camera.fu * rig_.camera.baseline / q.z()));
  return z;
}

std::optional<StereoModel::Triangulated> StereoModel::triangulate(const Filter& filter,
                                                                  const StereoPixels& measured) const {
  if (!(measured[0] > measured[2])) return std::nullopt;
  const StereoCamera camera = cameraOf(filter);
  const StereoPixels pixels = options_.unbiased_starts ? withoutBias(measured) : measured;
  const auto q = camera.triangulate(pixels);
  if (!q || q->z() < options_.min_depth_m || q->z() > options_.max_depth_m) return std::nullopt;
  const SE3 world_T_cam = camTWorld(filter).inverse();
  const Eigen::Matrix<double, 3, 4> J =
      options_.pixel_sigma * world_T_cam.rotation() * camera.triangulateJacobian(pixels);
  Triangulated result{world_T_cam * *q, J * J.transpose(), {}};
  // The depth, and with it q, is in proportion to the baseline.
  if (scale_)
    result.by = {filter.rowOf(*scale_),
                 world_T_cam.rotation() * *q / (1.0 + filter.variables().mean(*scale_)[0])};
  return result;
}

Eigen::Matrix3d StereoModel::noise() const {
  const double variance = options_.pixel_sigma * options_.pixel_sigma;
  return Eigen::Vector3d(variance, 0.5 * variance, variance).asDiagonal();
}

PointChart StereoModel::inverseDepthChart(const Filter& filter) const {
  const Eigen::Matrix3d cam_R_before = rig_.cam_T_imu.rotation() * filter.pose().rotation().transpose();
  const Eigen::Vector3d t = rig_.cam_T_imu.translation();
  return [cam_R_before, t](const Eigen::Matrix3d& turn, const Eigen::Vector3d& way,
                           const Eigen::Vector3d& d) -> std::optional<MovedPoint> {
    const Eigen::Matrix3d R = cam_R_before * turn.transpose();
    const Eigen::Vector3d q = R * way + t;
    if (!InverseDepth::isDefined(q)) return std::nullopt;
    const Eigen::Vector3d moved = InverseDepth::moved(q, R * d);
    return MovedPoint{R.transpose() * (moved - t),
                      R.transpose() * InverseDepth::pointJacobian(moved) * InverseDepth::jacobian(q) * R};
  };
}

} // namespace vi_ekf_slam

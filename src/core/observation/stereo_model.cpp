#include "vi_ekf_slam/core/observation/stereo_model.hpp"

#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/observation/inverse_depth.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kMaxPixel = 1e6; // px; beyond it a coordinate is not one of an image
// In units of the noise of one row, 4 standard deviations of the difference of two: one good feature in
// 16,000 has more.
constexpr double kSameRow = 5.66;
constexpr double kBehind = kSameRow; // the same of a disparity, of which what is far away has none

Eigen::Vector3d reduced(const StereoPixels& z) { return {z[0], 0.5 * (z[1] + z[3]), z[2]}; }

} // namespace

/// Of a far landmark whatever its noise makes of its disparity: where only the larger ones are taken, all far
/// ones come nearer.
bool StereoModel::isUsable(const StereoPixels& pixels, double sigma) const {
  return pixels.allFinite() && pixels.cwiseAbs().maxCoeff() <= kMaxPixel &&
         pixels[0] - pixels[2] >= -kBehind * sigmaOf(sigma) &&
         std::abs(pixels[1] - pixels[3]) <= kSameRow * sigmaOf(sigma);
}

/// The flow by which a landmark tells the distance d is f(rho) d, weighed by f(rho): a point whose noise puts
/// it too near is predicted with too much flow and has too much weight for it, so that sigma_rho^2 / rho^2 of
/// the distance would be lost on the average. With rho - sigma_rho^2 / rho, the mean under a prior 1 / rho,
/// E[rho (rho d - rho^ d)] is zero to that order. Half of it for each picture: the direction from the middle
/// of the pair is independent of the disparity.
StereoPixels StereoModel::withoutBias(const StereoPixels& pixels, double sigma) const {
  const double shift = sigma * sigma / (pixels[0] - pixels[2]);
  return pixels + StereoPixels(-shift, 0.0, shift, 0.0);
}

SE3 StereoModel::camTWorld(const Filter& filter, const Eigen::VectorXd& rig_error) const {
  SE3 pose = filter.pose();
  if (variables_.hasTimeOffset()) {
    const double ahead = variables_.timeOffset(filter, rig_error) - time_offset_;
    pose = pose * SE3(so3::Exp(ahead * twist_.tail<3>()), ahead * twist_.head<3>());
  }
  return variables_.camTImu(filter, rig_.cam_T_imu, rig_error) * pose.inverse();
}

std::optional<LinearMeasurement> StereoModel::observe(const Filter& filter, Handle landmark,
                                                      const StereoPixels& pixels, double sigma) const {
  const SE3 cam_T_world = camTWorld(filter);
  const StereoCamera camera = variables_.camera(filter, rig_.camera);
  const Eigen::Vector3d q = cam_T_world * filter.variables().point(landmark);
  if (!(q.z() >= options_.min_depth_m)) return std::nullopt;
  const Eigen::Matrix<double, 4, 3> by_point = camera.projectJacobian(q);
  Eigen::Matrix3d J;
  J << by_point.row(0), by_point.row(1), by_point.row(2);
  LinearMeasurement z(reduced(pixels) - reduced(camera.project(q)), noise(sigma));
  z.by(filter.rowOf(landmark), Eigen::Matrix3d(J * cam_T_world.rotation()));
  if (variables_.isNone()) return z;
  const Eigen::Matrix3Xd H = J * variables_.pointJacobian(filter, rig_.cam_T_imu, twist_)(q);
  for (Eigen::Index column = 0, size = 0; column < H.cols(); column += size) {
    size = std::min<Eigen::Index>(H.cols() - column, SmallMatrix::MaxColsAtCompileTime);
    z.by(variables_.row(filter) + column, H.middleCols(column, size));
  }
  return z;
}

void StereoModel::lookAtScene(Filter& filter, const StereoFrame& frame,
                              const std::vector<std::size_t>& features) {
  if (scene_) return;
  std::vector<double> disparities;
  double noise = 0.0;
  for (const std::size_t i : features) {
    const StereoFeatureObservation& f = frame.features[i];
    disparities.push_back(f.pixels[0] - f.pixels[2]);
    noise += 2.0 * sigmaOf(f.sigma) * sigmaOf(f.sigma);
  }
  scene_ = SceneDisparities::of(filter, disparities, noise / static_cast<double>(features.size()));
}

void StereoModel::forgetScene(Filter& filter) {
  if (scene_) filter.remove(scene_->mean());
  scene_.reset();
}

/// Any disparity that a scene has tells where the landmark lies; without one those that noise may have made
/// of none would not.
std::optional<StereoModel::Triangulated> StereoModel::triangulate(const Filter& filter,
                                                                  const StereoPixels& measured,
                                                                  double given) const {
  const double sigma = sigmaOf(given);
  if (!scene_ && !(measured[0] - measured[2] >= options_.min_disparity)) return std::nullopt;
  SceneDisparities::Predicted seen{measured, sigma * sigma * Eigen::Matrix4d::Identity(), 0.0};
  if (scene_)
    seen = scene_->predict(filter, measured, sigma);
  else if (options_.unbiased_starts)
    seen.pixels = withoutBias(measured, sigma);
  const StereoCamera camera = variables_.camera(filter, rig_.camera);
  const auto q = camera.triangulate(seen.pixels);
  if (!q || q->z() < options_.min_depth_m || q->z() > options_.max_depth_m) return std::nullopt;
  const SE3 world_T_cam = camTWorld(filter).inverse();
  const Eigen::Matrix<double, 3, 4> J = world_T_cam.rotation() * camera.triangulateJacobian(seen.pixels);
  Triangulated result{world_T_cam * *q, J * seen.noise * J.transpose(), {}};
  if (!variables_.isNone()) {
    const Eigen::Matrix3Xd Q = variables_.pointJacobian(filter, rig_.cam_T_imu, twist_)(*q);
    result.by = {variables_.row(filter), -(world_T_cam.rotation() * Q)};
  }
  if (scene_) result.by.add(filter.rowOf(scene_->mean()), 0.5 * seen.unknown * (J.col(0) - J.col(2)));
  return result;
}

Eigen::Matrix3d StereoModel::noise(double sigma) const {
  const double variance = sigmaOf(sigma) * sigmaOf(sigma);
  return Eigen::Vector3d(variance, 0.5 * variance, variance).asDiagonal();
}

Eigen::Matrix3d StereoModel::slideNoise(const Filter& filter, Handle landmark, double sigma) const {
  const SE3 cam_T_world = camTWorld(filter);
  const StereoCamera camera = variables_.camera(filter, rig_.camera);
  const double sigma_at_depth = sigma * (cam_T_world * filter.variables().point(landmark)).z();
  const Eigen::Vector3d variances(std::pow(sigma_at_depth / camera.fu, 2),
                                  std::pow(sigma_at_depth / camera.fv, 2), 0.0);
  const Eigen::Matrix3d cam_R_world = cam_T_world.rotation();
  return cam_R_world.transpose() * variances.asDiagonal() * cam_R_world;
}

/// What is corrected is q = R way + t as the pair sees it, R being cam_R_world, whose error is that of y and,
/// with Q = dq/dr, that of the calibration r: R (y + R^T Q r), of the point where it was seen. With R', t'
/// and Q' of the corrected calibration and point, and k by what its baseline grew, y <- R'^T (k M R (y + R^T
/// Q r) - Q' r): what moves nothing as it is seen (all distances and a longer baseline) still does not.
PointChart StereoModel::inverseDepthChart(const Filter& filter, const Eigen::VectorXd& error) const {
  const SE3 cam_T_world = camTWorld(filter);
  const Eigen::Matrix3d cam_R_before = cam_T_world.rotation();
  const Eigen::Vector3d t = cam_T_world * filter.pose().translation();
  if (!variables_.isNone()) {
    const Eigen::Index row = variables_.row(filter);
    Eigen::VectorXd r = Eigen::VectorXd::Zero(variables_.size());
    if (error.size() > 0) r = error.segment(row, r.size());
    const SE3 corrected = camTWorld(filter, r);
    const Eigen::Matrix3d cam_R_after = corrected.rotation();
    const Eigen::Vector3d t_after = corrected * filter.pose().translation();
    const auto before = variables_.pointJacobian(filter, rig_.cam_T_imu, twist_);
    const auto after = variables_.pointJacobian(filter, rig_.cam_T_imu, twist_, r);
    const double growth = variables_.scale(filter, r) / variables_.scale(filter);
    const auto move = [=](const Eigen::Matrix3d& turn, const Eigen::Vector3d& way,
                          const Eigen::Vector3d& d) -> std::optional<MovedPoint> {
      const Eigen::Matrix3d R = cam_R_before * turn.transpose();
      const Eigen::Matrix3d to_world = turn * cam_R_after.transpose();
      const Eigen::Vector3d q = R * way + t;
      if (!InverseDepth::isDefined(q)) return std::nullopt;
      const Eigen::Vector3d moved = InverseDepth::moved(q, R * d);
      const Eigen::Matrix3d M = growth * InverseDepth::pointJacobian(moved) * InverseDepth::jacobian(q);
      const Eigen::Vector3d now = growth * moved;
      return MovedPoint{to_world * (now - t_after), to_world * M * R, {row, -(to_world * after(now))}};
    };
    const auto seen = [=](const Eigen::Vector3d& way) {
      return LinearFunction{row, cam_R_before.transpose() * before(cam_R_before * way + t)};
    };
    return {move, seen, cam_R_before.transpose() * before.turn(r)};
  }
  const auto move = [cam_R_before, t](const Eigen::Matrix3d& turn, const Eigen::Vector3d& way,
                                      const Eigen::Vector3d& d) -> std::optional<MovedPoint> {
    const Eigen::Matrix3d R = cam_R_before * turn.transpose();
    const Eigen::Vector3d q = R * way + t;
    if (!InverseDepth::isDefined(q)) return std::nullopt;
    const Eigen::Vector3d moved = InverseDepth::moved(q, R * d);
    return MovedPoint{R.transpose() * (moved - t),
                      R.transpose() * InverseDepth::pointJacobian(moved) * InverseDepth::jacobian(q) * R,
                      {}};
  };
  return {move};
}

} // namespace vi_ekf_slam

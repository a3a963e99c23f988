#include "vi_ekf_slam/core/invariant/stereo_update.hpp"

#include "vi_ekf_slam/core/invariant/columns3.hpp"

namespace vi_ekf_slam::invariant {
namespace {

Eigen::Vector3d reduced(const StereoPixels& z) { return {z[0], 0.5 * (z[1] + z[3]), z[2]}; }

} // namespace

std::optional<Observation> StereoModel::observe(const State& state, std::size_t landmark,
                                                const StereoPixels& pixels) const {
  const SE3 cam_T_world = rig_.cam_T_imu * state.pose().inverse();
  const Eigen::Vector3d q = cam_T_world * state.landmarks()[landmark].position;
  if (!(q.z() >= min_depth_m_)) return std::nullopt;
  const Eigen::Matrix<double, 4, 3> by_point = rig_.camera.projectJacobian(q);
  Eigen::Matrix3d J;
  J << by_point.row(0), by_point.row(1), by_point.row(2);
  Observation observation;
  observation.landmark = landmark;
  observation.innovation = reduced(pixels) - reduced(rig_.camera.project(q));
  observation.jacobian = J * cam_T_world.rotation();
  return observation;
}

PooledMatrix StereoModel::crossCovariance(const State& state,
                                          const PooledVector<Observation>& observations) const {
  const auto P = state.covariance();
  PooledMatrix PHt(state.size(), rowsOf(observations.size()));
  Eigen::Index column = 0;
  for (const Observation& o : observations) {
    turnedFrom(P.middleCols<3>(kPosition), P.middleCols<3>(State::offsetOf(o.landmark)),
               o.jacobian.transpose(), PHt.middleCols<3>(column));
    column += 3;
  }
  return PHt;
}

PooledMatrix StereoModel::innovationCovariance(const PooledVector<Observation>& observations,
                                               const PooledMatrix& PHt) const {
  PooledMatrix S(PHt.cols(), PHt.cols());
  for (std::size_t j = 0; j < observations.size(); ++j) {
    const Eigen::Index column = rowsOf(j);
    const Eigen::Matrix3d position = PHt.block<3, 3>(kPosition, column);
    for (std::size_t i = j; i < observations.size(); ++i) {
      const Eigen::Matrix3d way =
          PHt.block<3, 3>(State::offsetOf(observations[i].landmark), column) - position;
      S.block<3, 3>(rowsOf(i), column).noalias() = observations[i].jacobian * way;
    }
    S.block<3, 3>(column, column) += noise();
  }
  return S;
}

Eigen::Matrix3d StereoModel::noise() const {
  const double variance = pixel_sigma_ * pixel_sigma_;
  return Eigen::Vector3d(variance, 0.5 * variance, variance).asDiagonal();
}

std::optional<StereoModel::Sighting> StereoModel::triangulate(const State& state, const StereoPixels& pixels,
                                                              double max_depth_m) const {
  const auto q = rig_.camera.triangulate(pixels);
  if (!q || q->z() < min_depth_m_ || q->z() > max_depth_m) return std::nullopt;
  const SE3 world_T_cam = state.pose() * rig_.cam_T_imu.inverse();
  const Eigen::Matrix<double, 3, 4> J =
      pixel_sigma_ * world_T_cam.rotation() * rig_.camera.triangulateJacobian(pixels);
  return Sighting{world_T_cam * *q, J * J.transpose()};
}

Pooled<Eigen::VectorXd> stackInnovations(const PooledVector<Observation>& observations) {
  Pooled<Eigen::VectorXd> innovations(rowsOf(observations.size()), 1);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    innovations.segment<3>(3 * static_cast<Eigen::Index>(i)) = observations[i].innovation;
  }
  return innovations;
}

SparseRows measurementMatrix(const PooledVector<Observation>& observations) {
  SparseRows H(rowsOf(observations.size()));
  Eigen::Index row = 0;
  for (const Observation& o : observations) {
    H.add(row, State::offsetOf(o.landmark), o.jacobian);
    H.add(row, kPosition, -o.jacobian);
    row += 3;
  }
  return H;
}

} // namespace vi_ekf_slam::invariant

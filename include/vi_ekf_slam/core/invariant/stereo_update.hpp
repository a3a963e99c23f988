#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"

namespace vi_ekf_slam::invariant {

/// One landmark seen again. A rectified pair measures three things, (u_left, v, u_right) with v the mean of
/// both rows, and y = R^T (m - p) moves by R^T (e - xi_p): the yaw of the world does not appear.
struct Observation {
  std::size_t landmark = 0;   ///< index in the state
  std::size_t feature = 0;    ///< index in the frame
  Eigen::Vector3d innovation; ///< px
  Eigen::Matrix3d jacobian;   ///< of the prediction by e - xi_p, px/m
};

/// Predicts and stacks the observations of one frame.
class StereoModel {
 public:
  /// `pixel_sigma` px of each of the four coordinates; landmarks nearer than `min_depth_m` are not predicted.
  StereoModel(const StereoRig& rig, double pixel_sigma, double min_depth_m)
      : rig_(rig), pixel_sigma_(pixel_sigma), min_depth_m_(min_depth_m) {}

  const StereoRig& rig() const { return rig_; }
  /// The same pair with another baseline, m.
  void setBaseline(double baseline) { rig_.camera.baseline = baseline; }

  /// The innovation of `pixels` against landmark `landmark` of `state`; nothing when it is not before the
  /// camera.
  std::optional<Observation> observe(const State& state, std::size_t landmark,
                                     const StereoPixels& pixels) const;

  /// P H^T, size() x (3 observations).
  PooledMatrix crossCovariance(const State& state, const PooledVector<Observation>& observations) const;

  /// S = H P H^T + noise, (3 observations) square, from PHt = crossCovariance: by 3x3 blocks,
  /// its lower triangle alone.
  PooledMatrix innovationCovariance(const PooledVector<Observation>& observations,
                                    const PooledMatrix& PHt) const;

  /// 3x3 of (u_left, v, u_right), px^2.
  Eigen::Matrix3d noise() const;

  /// Where a feature seen for the first time lies (world, m) and the covariance of its noise (world axes,
  /// m^2); nothing when the depth is outside [min_depth_m, max_depth_m].
  struct Sighting {
    Eigen::Vector3d position;
    Eigen::Matrix3d covariance;
  };
  std::optional<Sighting> triangulate(const State& state, const StereoPixels& pixels,
                                      double max_depth_m) const;

 private:
  StereoRig rig_;
  double pixel_sigma_;
  double min_depth_m_;
};

/// The innovations of all observations, one after the other.
Pooled<Eigen::VectorXd> stackInnovations(const PooledVector<Observation>& observations);

/// H of all observations, three rows each.
SparseRows measurementMatrix(const PooledVector<Observation>& observations);

} // namespace vi_ekf_slam::invariant

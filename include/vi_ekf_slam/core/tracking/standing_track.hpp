#pragma once

#include "vi_ekf_slam/core/observation/stereo_model.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Where a track that is not used is seen, and since when: one that stays there is of the static world after
/// all, one of a car is not.
class StandingTrack {
 public:
  /// Seen from where the filter says that the body is.
  StandingTrack(const Filter& filter, const StereoModel::Triangulated& seen, Stamp now);

  Stamp since() const { return since_; }
  /// How far off it is seen now, squared, in units of what the pixels and the body's motion since then allow
  /// (chi-square, 3 degrees of freedom).
  double distanceTo(const Filter& filter, const StereoModel::Triangulated& seen) const;

 private:
  Stamp since_;
  Eigen::Vector3d position_, body_; ///< m, world
  Eigen::Matrix3d noise_;           ///< m^2, world axes
  Matrix6d pose_covariance_;        ///< of the body then
};

} // namespace vi_ekf_slam

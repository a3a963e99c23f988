#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam::invariant {

/// What the filter's model leaves out and real drives show: tracks lag and slide together, so the whole
/// estimate (pose and landmarks in view) turns and shifts slowly about the vehicle: a random walk along the
/// directions that no measurement sees. Only a landmark that is seen again can tell, and no other gain
/// depends on it. Kept beside the filter's own covariance, in the same error (xi_p, xi_R), until it is taken.
class Drift {
 public:
  /// Root spectral densities over the DISTANCE driven, m/m^0.5 and rad/m^0.5.
  Drift(double position_density, double rotation_density)
      : position2_(position_density * position_density), rotation2_(rotation_density * rotation_density) {}

  /// The vehicle drove `distance` m around `position` (world, m).
  void drive(const Eigen::Vector3d& position, double distance);

  /// Turning the whole world about `position` by a random angle more, independently about the world axes with
  /// these variances (rad^2).
  void turn(const Eigen::Vector3d& position, const Eigen::Vector3d& variances);

  /// The covariance (6x6 of (xi_p, xi_R)) of what has not been taken yet: someone else accounts for it from
  /// now on.
  Matrix6d take();

  /// 3x3 along the world axes that is to be added to the position covariance of a point (world, m).
  Eigen::Matrix3d ofPoint(const Eigen::Vector3d& point) const;
  /// 6x6 of (position, rotation) along the world axes, to be added to that of a pose at `position`.
  Matrix6d ofPose(const Eigen::Vector3d& position) const;

 private:
  double position2_, rotation2_;
  Matrix6d covariance_ = Matrix6d::Zero(); ///< of (xi_p, xi_R)
};

} // namespace vi_ekf_slam::invariant

#pragma once

#include <Eigen/Core>

namespace vi_ekf_slam::invariant {

/// Watches whether the pair sees the world at the scale at which the measured velocity says that it moves.
///
/// A front end whose tracks lag, or a baseline that is off, makes every estimated motion too short by the
/// same share, which no amount of averaging removes and no chi-square test of a frame sees. The velocity
/// knows. The filter cannot hold this scale in its state: unobservable from the images, it would drift with
/// the noise of the depths. So it is estimated beside the filter, by a scalar Kalman filter on z / v - 1, and
/// corrected only once it is proven: a good pair stays untouched.
class ScaleMonitor {
 public:
  /// `sigma`: of the scale's error beforehand (1); `significance`: sigmas from which it counts as proven.
  ScaleMonitor(double sigma, double significance)
      : variance_(sigma * sigma), prior_sigma_(sigma), significance_(significance) {}

  /// Compares a measured velocity with the filter's before it is used. `velocity` and `covariance` are the
  /// filter's prediction in the IMU frame (m/s), `noise` the measurement's covariance.
  void compare(const Eigen::Vector3d& measured, const Eigen::Matrix3d& noise, const Eigen::Vector3d& velocity,
               const Eigen::Matrix3d& covariance);

  /// Factor for lengths that come from the pair: 1 until an error of scale is proven.
  double factor() const { return proven_ ? 1.0 + error_ : 1.0; }

 private:
  double error_ = 0.0;
  double variance_;
  double prior_sigma_;
  double significance_;
  bool proven_ = false;
};

} // namespace vi_ekf_slam::invariant

#pragma once

#include <optional>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam::paper {

/// The inverse pose U = imu_T_world with its covariance, as the paper keeps it: U = Exp(delta) U^,
/// delta = (translation, rotation) along the IMU's axes.
struct InversePose {
  SE3 imu_T_world;
  Matrix6d covariance = Matrix6d::Zero();
};

/// Transition of the error delta over `tau` s under the twist u: exp(-tau u^curlywedge), 6x6 (eq. 10).
Matrix6d errorTransition(const Vector6d& twist, double tau);

/// EKF prediction (eq. 11): mean exp(-tau u^) U, covariance F Sigma F^T + W, where W is the 6x6 of this step.
void predict(const Vector6d& twist, double tau, const Matrix6d& W, InversePose& pose);

/// The measured twist, each sample held until the next, and the clock that goes with it.
class TwistHold {
 public:
  /// Seconds from the last call's stamp to `stamp`; 0 at the first call.
  double advanceTo(Stamp stamp);
  void setLinear(const Eigen::Vector3d& v) { twist_.head<3>() = v; }
  void setAngular(const Eigen::Vector3d& omega) { twist_.tail<3>() = omega; }
  const Vector6d& twist() const { return twist_; }
  Stamp stamp() const { return stamp_.value_or(0); }

 private:
  Vector6d twist_ = Vector6d::Zero();
  std::optional<Stamp> stamp_;
};

} // namespace vi_ekf_slam::paper

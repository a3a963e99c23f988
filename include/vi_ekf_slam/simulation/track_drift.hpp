#pragma once

#include <optional>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// The error that the tracks of a real front end have in common: they lag and drift together, so that the
/// tracked world turns and shifts slowly about the vehicle. Its rate is a Gauss-Markov process (time constant
/// half a second, as measured on the KITTI drives against their truth); over longer distances it adds up to a
/// random walk with `drift_position` and `drift_rotation`.
class TrackDrift {
 public:
  explicit TrackDrift(const DriveOptions& options);

  /// To the next frame, from the IMU at `world_T_imu`.
  void advance(Stamp stamp, const SE3& world_T_imu);

  /// Where the world of a track that was new `then` seems to be now, against a track that is new now: a point
  /// m seems to be at slide() * then^-1 * m.
  const SE3& slide() const { return slide_; }

 private:
  Vector6d density_; ///< (position, rotation), m/m^0.5 and rad/m^0.5
  Random random_;
  Vector6d rate_ = Vector6d::Zero(); ///< of unit density, per s
  SE3 slide_;
  std::optional<Stamp> stamp_;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
};

} // namespace vi_ekf_slam::simulation

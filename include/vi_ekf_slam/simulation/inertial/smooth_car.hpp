#pragma once

#include <vector>

#include "vi_ekf_slam/simulation/block_path.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"

namespace vi_ekf_slam::simulation {

/// The car of CarMotion, as a body with accelerations: a spline through its stations over time, and one
/// through its path's poses over the stations. Speed and curvature change smoothly and every derivative is
/// exact.
class SmoothCarTrajectory : public Trajectory {
 public:
  explicit SmoothCarTrajectory(const DriveOptions& options);
  /// After the drive's end the car goes on at its last speed.
  Kinematics at(double t) const override;
  double distance(double t) const override;

 private:
  double stationControl(long i) const;
  PoseCoordinates poseControl(long i, double yaw_nearby) const;

  BlockPath path_;
  std::vector<double> stations_; ///< m, 8 bytes for half a second of driving
};

} // namespace vi_ekf_slam::simulation

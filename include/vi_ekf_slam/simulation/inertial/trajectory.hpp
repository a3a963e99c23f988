#pragma once

#include <Eigen/Core>
#include <memory>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/simulation/motion.hpp"

namespace vi_ekf_slam::simulation {

/// m/s^2, along -z of the world.
constexpr double kGravity = 9.81;

/// Position (m) and yaw, pitch, roll (rad) with R = Rz(yaw) Ry(pitch) Rx(roll), or derivatives of these.
using PoseCoordinates = Vector6d;

/// Coordinates with their first and second derivatives by time.
struct CoordinateMotion {
  PoseCoordinates value, rate, acceleration;
};

/// From coordinates to what a body feels. Exact, also where the pitch is 90 deg.
Kinematics kinematicsOf(const CoordinateMotion& motion);

/// What an ideal accelerometer measures, m/s^2, body axes: R^T (a - g).
Eigen::Vector3d specificForce(const Kinematics& body);

/// A motion with continuous accelerations, known exactly at any time.
class Trajectory {
 public:
  virtual ~Trajectory() = default;
  /// At `t` s after the start. The world's z axis points up.
  virtual Kinematics at(double t) const = 0;
  /// m travelled along the path until `t`, where the path goes on; 0 for one without an aim.
  virtual double distance(double /*t*/) const { return 0.0; }
};

/// A trajectory, step by step.
class TrajectoryMotion : public Motion {
 public:
  explicit TrajectoryMotion(std::unique_ptr<const Trajectory> trajectory);
  Vector6d begin(double dt) override;
  void move(double dt) override;
  double distance() const override { return trajectory_->distance(toSeconds(time_)); }
  std::optional<Kinematics> kinematics(double ahead) const override {
    return ahead == 0.0 ? now_ : trajectory_->at(toSeconds(time_) + ahead);
  }

 private:
  std::unique_ptr<const Trajectory> trajectory_;
  Stamp time_ = 0; ///< ns since the start: sums of steps stay exact
  Kinematics now_;
};

} // namespace vi_ekf_slam::simulation

#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/simulation/block_path.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// How a body moves at an instant.
struct Kinematics {
  SE3 world_T_imu;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();         ///< m/s, world axes
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();     ///< m/s^2, world axes
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero(); ///< rad/s, IMU axes
};

/// How the vehicle moves.
class Motion {
 public:
  virtual ~Motion() = default;

  /// Begins a step of `dt` s, from one sample of the IMU to the next. Returns the twist nu_k = (v in m/s,
  /// omega in rad/s) in the IMU frame that an IMU measures now.
  virtual Vector6d begin(double dt) = 0;
  /// Moves on by `dt` s within the step.
  virtual void move(double dt) = 0;
  /// A whole step.
  Vector6d step(double dt) {
    const Vector6d twist = begin(dt);
    move(dt);
    return twist;
  }
  /// m travelled so far along the path, where it goes on; 0 for a motion without an aim.
  virtual double distance() const { return 0.0; }
  /// What an accelerometer feels now, where the motion has accelerations.
  virtual std::optional<Kinematics> kinematics(double /*ahead*/ = 0.0) const { return std::nullopt; }

  /// The first is the identity, but where there are accelerations: there the world's z axis points up.
  const SE3& world_T_imu() const { return world_T_imu_; }

 protected:
  SE3 world_T_imu_;
};

/// Laps round a block: the poses are those of the path, nu_k = Log(T_k^-1 T_{k+1}) / dt is held throughout
/// the step.
class CarMotion : public Motion {
 public:
  explicit CarMotion(const DriveOptions& options);
  Vector6d begin(double dt) override;
  void move(double dt) override;
  double distance() const override { return station_; }

 private:
  double allowedSpeed() const;

  BlockPath path_;
  SE3 world_T_path_;
  double straight_speed_, corner_speed_;
  double station_ = 0.0;
  double speed_ = 0.0;
  Vector6d twist_ = Vector6d::Zero(); ///< of the step
  double rest_;                       ///< s still to stand
  double corner_stop_;                ///< s to stand at `stop_station_`; 0 once done
  double stop_station_;
};

/// White noise of spectral density Q on the twist's derivative, from the twist (speed, 0, 0, 0, 0, 0):
///
///   nu_{k+1} = nu_k + w2,   T_{k+1} = T_k Exp(dt (nu_k + w1)),   w2 ~ N(0, Q dt),   w1 = w2 / 2 + N(0, Q dt
///   / 12).
///
/// w1 is the mean over the step of what the walk adds to nu_k: cov(w1) = Q dt / 3, cov(w1, w2) = Q dt / 2, so
/// that the motion has the same law whatever the step (the turn within one step taken as small). nu_k is the
/// instantaneous twist at t_k. With twist_decay tau the twist returns to its first value n: nu_{k+1} = n +
/// exp(-dt / tau) (nu_k - n) + w2, and the noise is right to first order in dt / tau.
class ProcessMotion : public Motion {
 public:
  explicit ProcessMotion(const DriveOptions& options);
  Vector6d begin(double /*dt*/) override { return twist_; }
  void move(double dt) override;

 private:
  Random random_;
  Vector6d nominal_, twist_, noise_;
  double decay_;
};

} // namespace vi_ekf_slam::simulation

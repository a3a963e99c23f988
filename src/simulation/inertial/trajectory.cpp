#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"

#include <cmath>
#include <utility>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::simulation {

Kinematics kinematicsOf(const CoordinateMotion& motion) {
  const double yaw = motion.value[3], pitch = motion.value[4], roll = motion.value[5];
  const double dyaw = motion.rate[3], dpitch = motion.rate[4], droll = motion.rate[5];
  Kinematics body;
  const Eigen::Matrix3d R =
      so3::Exp({0.0, 0.0, yaw}) * so3::Exp({0.0, pitch, 0.0}) * so3::Exp({roll, 0.0, 0.0});
  body.world_T_imu = SE3(R, motion.value.head<3>());
  body.velocity = motion.rate.head<3>();
  body.acceleration = motion.acceleration.head<3>();
  body.angular_velocity = {droll - dyaw * std::sin(pitch),
                           dpitch * std::cos(roll) + dyaw * std::cos(pitch) * std::sin(roll),
                           dyaw * std::cos(pitch) * std::cos(roll) - dpitch * std::sin(roll)};
  return body;
}

Eigen::Vector3d specificForce(const Kinematics& body) {
  const Eigen::Vector3d gravity(0.0, 0.0, -kGravity);
  return body.world_T_imu.rotation().transpose() * (body.acceleration - gravity);
}

TrajectoryMotion::TrajectoryMotion(std::unique_ptr<const Trajectory> trajectory)
    : trajectory_(std::move(trajectory)), now_(trajectory_->at(0.0)) {
  world_T_imu_ = now_.world_T_imu;
}

Vector6d TrajectoryMotion::begin(double /*dt*/) {
  Vector6d twist;
  twist << world_T_imu_.rotation().transpose() * now_.velocity, now_.angular_velocity;
  return twist;
}

void TrajectoryMotion::move(double dt) {
  time_ += fromSeconds(dt);
  now_ = trajectory_->at(toSeconds(time_));
  world_T_imu_ = now_.world_T_imu;
}

} // namespace vi_ekf_slam::simulation

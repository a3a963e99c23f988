#include "vi_ekf_slam/ros/node/told_state.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kUnitNorm = 1e-3;      // that a quaternion's norm may differ by from 1
constexpr double kFarthest = 1e7;       // m; a vehicle's map is on the Earth
constexpr double kLargestGyroBias = 10; // rad/s
constexpr double kLargestBias = 100;    // m/s^2

Eigen::Vector3d vector(const geometry_msgs::Vector3& v) { return {v.x, v.y, v.z}; }

/// Empty: its norm is at most `limit`.
std::string normProblem(const std::string& name, const Eigen::Vector3d& value, double limit,
                        const std::string& unit) {
  if (value.norm() <= limit) return {};
  return name + " must be finite, of a norm of at most " + std::to_string(limit) + " " + unit;
}

} // namespace

std::string readToldState(const SetState::Request& request, const std::string& map_frame,
                          const BaseFrame& base, InitialState& state) {
  using Matrix15d = Eigen::Matrix<double, 15, 15>;
  const std::string frame = conversions::frameName(request.header.frame_id);
  if (frame != map_frame)
    return "header.frame_id is '" + frame + "', allowed: the map's frame '" + map_frame + "'";
  if (request.header.stamp.isZero()) return "header.stamp is 0, it must be that of the state";
  const auto& p = request.pose.position;
  const auto& q = request.pose.orientation;
  const Eigen::Vector3d position(p.x, p.y, p.z), velocity = vector(request.velocity);
  const Eigen::Quaterniond rotation(q.w, q.x, q.y, q.z);
  state.gyro_bias = vector(request.gyro_bias);
  state.accelerometer_bias = vector(request.accelerometer_bias);
  if (!(std::abs(rotation.norm() - 1.0) <= kUnitNorm))
    return "pose.orientation has the norm " + std::to_string(rotation.norm()) + ", allowed: 1";
  for (const std::string& problem :
       {normProblem("pose.position", position, kFarthest, "m"),
        normProblem("velocity", velocity, kMaxSpeed, "m/s"),
        normProblem("gyro_bias", state.gyro_bias, kLargestGyroBias, "rad/s"),
        normProblem("accelerometer_bias", state.accelerometer_bias, kLargestBias, "m/s^2")}) {
    if (!problem.empty()) return problem;
  }
  const Matrix15d P =
      Eigen::Map<const Eigen::Matrix<double, 15, 15, Eigen::RowMajor>>(request.covariance.data());
  if (!P.allFinite() || !P.isApprox(P.transpose(), 1e-6) || P.llt().info() != Eigen::Success)
    return "covariance must be a symmetric positive definite 15 x 15 matrix, row by row";
  // World vectors turn with the world.
  const SE3 world_T_map = base.mapFromWorld().inverse();
  Matrix15d turn = Matrix15d::Identity();
  for (const Eigen::Index i : {0, 3, 6}) turn.block<3, 3>(i, i) = world_T_map.rotation();
  state.stamp = conversions::toStamp(request.header.stamp);
  state.world_T_imu = world_T_map * SE3(rotation.normalized().toRotationMatrix(), position);
  state.velocity = world_T_map.rotation() * velocity;
  const Matrix15d turned = turn * P * turn.transpose();
  state.covariance = 0.5 * (turned + turned.transpose());
  return {};
}

} // namespace vi_ekf_slam

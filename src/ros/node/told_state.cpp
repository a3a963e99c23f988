#include "vi_ekf_slam/ros/node/told_state.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kUnitNorm = 1e-3; // that a quaternion's norm may differ by from 1

Eigen::Vector3d vector(const geometry_msgs::Vector3& v) { return {v.x, v.y, v.z}; }

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
  const Eigen::Quaterniond rotation(q.w, q.x, q.y, q.z);
  if (!(std::abs(rotation.norm() - 1.0) <= kUnitNorm))
    return "pose.orientation has the norm " + std::to_string(rotation.norm()) + ", allowed: 1";
  const SE3 map_T_imu(rotation.normalized().toRotationMatrix(), {p.x, p.y, p.z});
  state = {conversions::toStamp(request.header.stamp),
           map_T_imu,
           vector(request.velocity),
           vector(request.gyro_bias),
           vector(request.accelerometer_bias),
           Eigen::Map<const Eigen::Matrix<double, 15, 15, Eigen::RowMajor>>(request.covariance.data())};
  if (const auto bad = badFieldOf(state))
    return bad->name + " is " + bad->value + ", allowed: " + bad->allowed;
  // World vectors turn with the world.
  const SE3 world_T_map = base.mapFromWorld().inverse();
  Matrix15d turn = Matrix15d::Identity();
  for (const Eigen::Index i : {0, 3, 6}) turn.block<3, 3>(i, i) = world_T_map.rotation();
  state.world_T_imu = world_T_map * map_T_imu;
  state.velocity = (world_T_map.rotation() * state.velocity).eval();
  const Matrix15d turned = turn * state.covariance * turn.transpose();
  state.covariance = 0.5 * (turned + turned.transpose());
  return {};
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/ros/node/told.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kMaxDistance = 1e7;                              // m; a vehicle's map is on the Earth
constexpr double kUnsaidPosition = 0.1, kUnsaidRotation = 0.1;    // m, rad; of an axis without a variance
constexpr double kDefaultPosition = 0.5, kDefaultRotation = 0.26; // m, rad; rviz's

std::string frameProblem(const std_msgs::Header& header, const std::string& map_frame) {
  const std::string frame = conversions::frameName(header.frame_id);
  if (frame == map_frame) return {};
  return "header.frame_id is '" + frame + "', allowed: the map's frame '" + map_frame + "'";
}

/// `tolerance`: of the quaternion's norm.
std::string rotationProblem(const geometry_msgs::Pose& pose, double tolerance) {
  const double norm = conversions::toEigen(pose.orientation).norm();
  if (std::abs(norm - 1.0) <= tolerance) return {};
  return "pose.orientation has the norm " + std::to_string(norm) + ", allowed: 1";
}

void fillIn(Matrix6d& covariance, double position_sigma, double rotation_sigma) {
  for (Eigen::Index i = 0; i < 6; ++i) {
    const double sigma = i < 3 ? position_sigma : rotation_sigma;
    if (covariance(i, i) == 0.0) covariance(i, i) = sigma * sigma;
  }
}

} // namespace

std::string readToldPose(const geometry_msgs::PoseWithCovarianceStamped& message,
                         const std::string& map_frame, const BaseFrame& base, const SE3& motion,
                         ToldPose& told) {
  if (const std::string problem = frameProblem(message.header, map_frame); !problem.empty()) return problem;
  if (base.name().empty())
    return base.problem().empty() ? "the IMU's frame is not known yet: no imu message has come"
                                  : base.problem();
  const geometry_msgs::Pose& pose = message.pose.pose;
  if (!(conversions::toEigen(pose.position).norm() <= kMaxDistance))
    return "pose.position must be finite, at most 1e7 m from the origin";
  if (const std::string problem = rotationProblem(pose, 0.01); !problem.empty()) return problem;
  Matrix6d covariance =
      Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(message.pose.covariance.data());
  const bool none = covariance.isZero(0.0);
  fillIn(covariance, none ? kDefaultPosition : kUnsaidPosition, none ? kDefaultRotation : kUnsaidRotation);
  const bool symmetric = covariance.allFinite() && covariance.isApprox(covariance.transpose(), 1e-6);
  if (!symmetric || covariance.llt().info() != Eigen::Success)
    return "pose.covariance is not symmetric and positive definite";
  const SE3 map_T_base = conversions::toSE3(pose) * motion;
  told.world_T_imu = base.imuPose(map_T_base);
  told.covariance = base.imuCovariance(map_T_base, 0.5 * (covariance + covariance.transpose()));
  return {};
}

std::string readToldState(const SetState::Request& request, const std::string& map_frame,
                          const BaseFrame& base, InitialState& state) {
  using conversions::toEigen;
  using Matrix15d = Eigen::Matrix<double, 15, 15>;
  if (const std::string problem = frameProblem(request.header, map_frame); !problem.empty()) return problem;
  if (request.header.stamp.isZero()) return "header.stamp is 0, it must be that of the state";
  if (const std::string problem = rotationProblem(request.pose, 1e-3); !problem.empty()) return problem;
  const SE3 map_T_imu = conversions::toSE3(request.pose);
  state = {conversions::toStamp(request.header.stamp),
           map_T_imu,
           toEigen(request.velocity),
           toEigen(request.gyro_bias),
           toEigen(request.accelerometer_bias),
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

#include "vi_ekf_slam/ros/node/told_pose.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kUnitTolerance = 0.01;                           // of a quaternion's norm
constexpr double kMaxDistance = 1e7;                              // m; a vehicle's map is on the Earth
constexpr double kUnsaidPosition = 0.1, kUnsaidRotation = 0.1;    // m, rad; of an axis without a variance
constexpr double kDefaultPosition = 0.5, kDefaultRotation = 0.26; // m, rad; rviz's

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
  const std::string frame = conversions::frameName(message.header.frame_id);
  if (frame != map_frame)
    return "header.frame_id is '" + frame + "', allowed: the map's frame '" + map_frame + "'";
  if (base.name().empty())
    return base.problem().empty() ? "the IMU's frame is not known yet: no imu message has come"
                                  : base.problem();
  const auto& p = message.pose.pose.position;
  const auto& q = message.pose.pose.orientation;
  const Eigen::Vector3d position(p.x, p.y, p.z);
  const Eigen::Quaterniond rotation(q.w, q.x, q.y, q.z);
  if (!(position.norm() <= kMaxDistance))
    return "pose.position must be finite, at most 1e7 m from the origin";
  if (!(std::abs(rotation.norm() - 1.0) <= kUnitTolerance))
    return "pose.orientation has the norm " + std::to_string(rotation.norm()) + ", allowed: 1";
  Matrix6d covariance =
      Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(message.pose.covariance.data());
  const bool none = covariance.isZero(0.0);
  fillIn(covariance, none ? kDefaultPosition : kUnsaidPosition, none ? kDefaultRotation : kUnsaidRotation);
  const bool symmetric = covariance.allFinite() && covariance.isApprox(covariance.transpose(), 1e-6);
  if (!symmetric || covariance.llt().info() != Eigen::Success)
    return "pose.covariance is not symmetric and positive definite";
  const SE3 map_T_base = SE3(rotation.normalized().toRotationMatrix(), position) * motion;
  told.world_T_imu = base.imuPose(map_T_base);
  told.covariance = base.imuCovariance(map_T_base, 0.5 * (covariance + covariance.transpose()));
  return {};
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/tracking/standing_track.hpp"

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

StandingTrack::StandingTrack(const Filter& filter, const StereoModel::Triangulated& seen, Stamp now)
    : since_(now),
      position_(seen.position),
      body_(filter.pose().translation()),
      noise_(seen.noise),
      pose_covariance_(filter.covariance().topLeftCorner<6, 6>()) {}

/// Nothing tells the pose in the world, so what its covariance has gained, about the same position, is that
/// of the motion: x - x^ = [I, -[x - p]x] (dp, theta).
double StandingTrack::distanceTo(const Filter& filter, const StereoModel::Triangulated& seen) const {
  const Eigen::Vector3d& p = filter.pose().translation();
  Matrix6d transport = Matrix6d::Identity();
  transport.topRightCorner<3, 3>() = -so3::hat(p - body_);
  const Matrix6d motion =
      filter.covariance().topLeftCorner<6, 6>() - transport * pose_covariance_ * transport.transpose();
  const Eigen::Matrix<double, 3, 6> J = se3::pointJacobian(seen.position - p);
  const Eigen::Matrix3d S = noise_ + seen.noise + J * motion * J.transpose();
  return squaredMahalanobis(Eigen::Vector3d(seen.position - position_), S);
}

} // namespace vi_ekf_slam

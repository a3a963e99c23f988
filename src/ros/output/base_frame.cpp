#include "vi_ekf_slam/ros/output/base_frame.hpp"

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

Matrix6d symmetric(const Matrix6d& m) { return 0.5 * (m + m.transpose()); }

/// Covariance (position, rotation, fixed axes) of a point that is fixed to a body at `arm` (fixed axes) from
/// the point that `covariance` is of, dp' = dp + dtheta x arm, along axes that `rotation` turns these to.
Matrix6d carried(const Matrix6d& covariance, const Eigen::Vector3d& arm, const Eigen::Matrix3d& rotation) {
  Matrix6d J = Matrix6d::Identity(), turn = Matrix6d::Zero();
  J.topRightCorner<3, 3>() = -so3::hat(arm);
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = rotation;
  const Matrix6d shifted = J * covariance * J.transpose();
  return symmetric(turn * shifted * turn.transpose());
}

} // namespace

bool BaseFrame::update(const std::string& imu_frame, const std::optional<SE3>& start) {
  if (!name_.empty() && imu_frame == imu_frame_ && start.has_value() == has_start_) return true;
  imu_frame_ = imu_frame;
  has_start_ = start.has_value();
  name_.clear();
  base_T_imu_.reset();
  has_changed_ = false;
  map_T_world_ = SE3();
  if (imu_frame.empty()) return false;
  const std::string& base = config_.base_frame.empty() ? imu_frame : config_.base_frame;
  if (base != imu_frame) {
    const auto base_T_imu = frames_.find(base, imu_frame);
    if (!base_T_imu || !(base_T_imu->translation().norm() <= kVehicleSize)) return false;
    base_T_imu_ = base_T_imu;
    const Eigen::Vector3d heading(0.0, 0.0, so3::heading(base_T_imu->rotation()));
    map_T_world_ = start ? *base_T_imu * start->inverse() : SE3(so3::Exp(heading), base_T_imu->translation());
  }
  name_ = base;
  return true;
}

void BaseFrame::noteTransforms() {
  const auto base_T_imu = base_T_imu_ ? frames_.find(name_, imu_frame_) : std::nullopt;
  has_changed_ = has_changed_ || (base_T_imu && hasMoved(*base_T_imu_, *base_T_imu));
}

std::string BaseFrame::change() const {
  if (!has_changed_) return {};
  return "the transform from base_frame '" + name_ + "' to the IMU's frame '" + imu_frame_ +
         "' has changed; the first one stays in use until a restart";
}

std::string BaseFrame::problem() const {
  if (imu_frame_.empty()) return {}; // no IMU message yet, which is said elsewhere
  if (name_.empty())
    return "no pose is published: no transform of at most 100 m connects base_frame '" + config_.base_frame +
           "' to the IMU's frame '" + imu_frame_ + "'; publish it on /tf_static, as a robot description does";
  if (config_.publish_tf && isImuOfWorld())
    return "no transform is published: the IMU's frame, header.frame_id of imu, is '" + imu_frame_ +
           "', allowed: another one than ros/map_frame and ros/odom_frame; set it in the IMU's driver";
  const bool sends_base = config_.publish_tf && (config_.publish_odom_tf || config_.single_tf);
  if (!sends_base || foreign_parent_.empty()) return {};
  const std::string what = "no transform is published, since somebody else publishes '" + foreign_parent_ +
                           "' -> '" + name_ + "': ";
  return what + (foreign_parent_ == config_.odom_frame
                     ? "set ros/publish_odom_tf to false, if that is another odometry"
                     : "set ros/base_frame to the root of the robot's frames, since a frame has one parent");
}

SE3 BaseFrame::pose(const SE3& world_T_imu) const {
  if (!base_T_imu_) return world_T_imu;
  return map_T_world_ * world_T_imu * base_T_imu_->inverse();
}

SE3 BaseFrame::imuPose(const SE3& map_T_base) const {
  if (!base_T_imu_) return map_T_base;
  return map_T_world_.inverse() * map_T_base * *base_T_imu_;
}

StateEstimate BaseFrame::state(const StateEstimate& of_imu) const {
  if (!base_T_imu_) return of_imu;
  StateEstimate of_base = of_imu;
  of_base.world_T_imu = pose(of_imu.world_T_imu);
  const Eigen::Vector3d arm = of_imu.world_T_imu.rotation() * base_T_imu_->inverse().translation();
  of_base.pose_covariance = carried(of_imu.pose_covariance, arm, map_T_world_.rotation());
  const Matrix6d adjoint = base_T_imu_->adjoint(); // v_base = R (v + omega x arm)
  of_base.twist = adjoint * of_imu.twist;
  of_base.twist_covariance = symmetric(adjoint * of_imu.twist_covariance * adjoint.transpose());
  return of_base;
}

Matrix6d BaseFrame::imuCovariance(const SE3& map_T_base, const Matrix6d& covariance) const {
  if (!base_T_imu_) return covariance;
  const Eigen::Vector3d arm = map_T_base.rotation() * base_T_imu_->translation();
  return carried(covariance, arm, map_T_world_.rotation().transpose());
}

PathEstimate BaseFrame::path(PathEstimate of_imu) const {
  if (!base_T_imu_) return of_imu;
  for (PathNode& node : of_imu.nodes) {
    const Eigen::Vector3d arm = node.now.rotation() * base_T_imu_->inverse().translation();
    for (Matrix6d* P : {&node.covariance, &node.covariance_soon, &node.learned})
      *P = carried(*P, arm, map_T_world_.rotation());
    for (SE3* of_node : {&node.before, &node.after, &node.now}) *of_node = pose(*of_node);
  }
  return of_imu;
}

ClosedLoop BaseFrame::loop(ClosedLoop of_imu) const {
  if (!base_T_imu_) return of_imu;
  const SE3 imu_T_base = base_T_imu_->inverse();
  const Eigen::Vector3d arm = of_imu.before_T_now.rotation() * imu_T_base.translation();
  of_imu.covariance = carried(of_imu.covariance, arm, base_T_imu_->rotation());
  of_imu.before_T_now = *base_T_imu_ * of_imu.before_T_now * imu_T_base;
  return of_imu;
}

std::vector<LandmarkEstimate> BaseFrame::landmarks(std::vector<LandmarkEstimate> in_world) const {
  if (!base_T_imu_) return in_world;
  const Eigen::Matrix3d& R = map_T_world_.rotation();
  for (LandmarkEstimate& landmark : in_world) {
    landmark.position = map_T_world_ * landmark.position;
    landmark.covariance = R * landmark.covariance * R.transpose();
  }
  return in_world;
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/filter/pose_reset.hpp"

#include "vi_ekf_slam/core/filter/validity.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

/// Truth and estimate move by the same T <- T motion, so that the error of before stays, about the new
/// position: dp' = dp - [p' - p]x theta. A velocity stays what it is along the body's axes.
void resetPose(Filter& filter, const SE3& motion, const Matrix6d& covariance) {
  CoreStep step;
  step.pose = (filter.pose() * motion).normalized();
  const Eigen::Matrix3d turn = step.pose.rotation() * filter.pose().rotation().transpose();
  step.F.setIdentity(6, 6);
  for (const Handle handle : filter.variables().handles()) {
    const Eigen::Index row = filter.rowOf(handle);
    if (row >= filter.coreRows()) break;
    if (filter.variables().chartOf(handle) != Chart::kWorldVector) continue;
    step.F.conservativeResizeLike(CoreSquare::Identity(row + 3, row + 3));
    step.F.block<3, 3>(row, row) = turn;
    step.means.emplace_back(handle, turn * filter.variables().mean(handle));
  }
  step.F.block<3, 3>(0, 3) = -so3::hat(step.pose.translation() - filter.pose().translation());
  step.Q = covariance;
  filter.propagate(step);
  filter.settle();
}

bool tellPose(Filter& filter, const SE3& pose, const Matrix6d& covariance) {
  const bool level = filter.isLevel();
  const SE3 there = level ? levelled(pose, filter.pose()) : pose;
  resetPose(filter, filter.pose().inverse() * there, anyPose(level));
  // Of (dp, theta), or (dp, heading).
  const Eigen::Index rows = level ? 4 : 6;
  SmallMatrix H = SmallMatrix::Identity(rows, 6), noise = covariance;
  if (level) {
    H.row(3) << 0.0, 0.0, 0.0, 0.0, 0.0, 1.0;
    noise = H * covariance * H.transpose();
  }
  return filter.correct(LinearMeasurement(SmallVector::Zero(rows), noise).by(0, H)) && isValid(filter, true);
}

} // namespace vi_ekf_slam

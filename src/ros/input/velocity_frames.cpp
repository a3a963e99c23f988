#include "vi_ekf_slam/ros/input/velocity_frames.hpp"

namespace vi_ekf_slam {
bool VelocityFrames::carry(VelocitySample& sample, const std::string& frame) {
  if (imu_frame_.empty()) return false;
  if (frame == imu_frame_) return true;
  if (isImpossible(frame)) return false;
  auto known = imu_T_frame_.find(frame);
  if (known == imu_T_frame_.end()) {
    const auto imu_T_frame = frames_.find(imu_frame_, frame);
    const bool usable = imu_T_frame && imu_T_frame->translation().norm() <= kVehicleSize;
    if (!usable || imu_T_frame_.size() >= kMostFrames) return false;
    known = imu_T_frame_.emplace(frame, *imu_T_frame).first;
  }
  const Eigen::Matrix3d& R = known->second.rotation();
  sample.linear_velocity = R * sample.linear_velocity;
  if (sample.covariance) {
    const Eigen::Matrix3d turned = R * *sample.covariance * R.transpose();
    sample.covariance = 0.5 * (turned + turned.transpose());
  }
  sample.lever_arm = known->second.translation();
  return true;
}

std::string VelocityFrames::problem(const std::string& frame) const {
  const std::string what = "velocity in '" + frame + "' is not used: ";
  if (isImpossible(frame))
    return what + "a frame of the vehicle is needed (header.frame_id, of Odometry child_frame_id), such as " +
           (imu_frame_.empty() ? "the IMU's" : "'" + imu_frame_ + "'");
  if (imu_frame_.empty())
    return what +
           "the IMU's frame is not known, since no IMU message came; configure ros/imu_frame to go without";
  if (frames_.find(imu_frame_, frame))
    return what + "its transform to the IMU's frame '" + imu_frame_ + "' is longer than 100 m";
  return what + "no transform connects it to the IMU's frame '" + imu_frame_ +
         "'; publish it on /tf_static (a robot description does), or set header.frame_id to '" + imu_frame_ +
         "' if it is the IMU's velocity";
}

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/front_end/gyro_rotation.hpp"

namespace vi_ekf_slam {

/// How the rectified left camera will have moved from one pair to the next: as it did before, but for the
/// rotation where the gyro has measured it.
class MotionPredictor {
 public:
  struct Prediction {
    SE3 now_T_before;
    bool rotation_known; ///< by the gyro
  };

  /// cam_R_imu: turns directions of the IMU frame into those of the rectified left camera. Without it the
  /// gyro says nothing.
  void setImuRotation(const Eigen::Matrix3d& cam_R_imu) { cam_R_imu_ = cam_R_imu; }
  void addImu(const ImuSample& sample) { gyro_.add(sample); }
  /// Samples before `stamp` are not asked for any more.
  void forgetBefore(Stamp stamp) { gyro_.forgetBefore(stamp); }

  Prediction predict(Stamp before, Stamp now) const;
  /// What it predicted for so many seconds, without what the gyro has been off by.
  SE3 withoutBias(const SE3& now_T_before, double seconds) const;
  /// How it has moved within `seconds`, and what was predicted of it; nothing: not known, so that it is taken
  /// to be at rest.
  void learn(const std::optional<SE3>& now_T_before, const Prediction& prediction, double seconds);

 private:
  GyroRotation gyro_;
  std::optional<Eigen::Matrix3d> cam_R_imu_;
  Vector6d velocity_ = Vector6d::Zero();           ///< m/s and rad/s, as now_T_before has it
  Eigen::Vector3d bias_ = Eigen::Vector3d::Zero(); ///< rad/s, what it turns beyond what the gyro says
  int bias_pairs_ = 0;                             ///< of which that is the mean
};

} // namespace vi_ekf_slam

#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <std_msgs/Header.h>
#include <tf2_msgs/TFMessage.h>

#include <optional>
#include <string>

#include "vi_ekf_slam/front_end/stereo_calibration.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// The calibration that the two camera_infos describe; nothing, and in `problem` a sentence that names topic,
/// field, value and what is allowed, where they describe none.
std::optional<StereoCalibration> stereoCalibration(const sensor_msgs::CameraInfo& left,
                                                   const sensor_msgs::CameraInfo& right, ImageKind images,
                                                   const InputTopics& topics, std::string& problem);

/// What images need to be followed: the cameras as their two CameraInfo messages describe them, and how the
/// left one sits on the IMU. The first complete calibration holds.
class PairCalibration {
 public:
  /// Names of the topics are for messages. Without an `imu_frame` the IMU's first message names it.
  PairCalibration(ImageKind images, const InputTopics& topics, const std::string& imu_frame)
      : images_(images), topics_(topics), imu_frame_(imu_frame) {}

  void addLeft(const sensor_msgs::CameraInfo& info);
  void addRight(const sensor_msgs::CameraInfo& info);
  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static);
  /// A message of the IMU has come.
  void addImu(const std_msgs::Header& header);

  const std::optional<StereoCalibration>& cameras() const { return cameras_; }
  /// Turns directions of the IMU frame into those of the rectified left camera; nothing as long as cameras or
  /// transform are not known.
  const std::optional<Eigen::Matrix3d>& cam_R_imu() const { return cam_R_imu_; }
  /// Empty as long as it is not known.
  const std::string& imuFrame() const { return imu_frame_; }
  /// Left optical frame; empty as long as it is not known.
  const std::string& leftFrame() const { return left_frame_; }
  /// What is missing or wrong with the cameras, as a sentence; empty once they are known.
  std::string problem() const;

 private:
  void updateCameras();
  void updateRotation();

  ImageKind images_;
  InputTopics topics_;
  FrameTree frames_;
  std::optional<sensor_msgs::CameraInfo> left_, right_;
  std::string imu_frame_, left_frame_, problem_;
  std::optional<StereoCalibration> cameras_;
  std::optional<Eigen::Matrix3d> cam_R_imu_;
};

} // namespace vi_ekf_slam

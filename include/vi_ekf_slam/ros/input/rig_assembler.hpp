#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <optional>
#include <string>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/ros/input/feature_screen.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"

namespace vi_ekf_slam {

/// What keeps the two from describing a stereo pair with rectified images of one size, by P and R; a sentence
/// that names topic, field and value, or empty: nothing.
std::string stereoProblem(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right,
                          const std::string& left_topic, const std::string& right_topic);
/// The rectified pair that P of both describes; stereoProblem must be empty.
StereoCamera stereoCamera(const sensor_msgs::CameraInfo& left, const sensor_msgs::CameraInfo& right);
/// R of a CameraInfo, rectified_R_raw; the identity where it is left zero, as for images that nobody
/// rectifies.
Eigen::Matrix3d rectification(const sensor_msgs::CameraInfo& info);

/// Puts the calibration together from what ROS carries: two CameraInfo messages, of which P counts and R of
/// the left one, and the transform from the IMU to the left optical frame. The first complete calibration
/// holds.
///
/// The left CameraInfo's frame_id is the frame of the camera as it is mounted; the rectified left image is
/// one of a camera turned by R.
class RigAssembler {
 public:
  /// `frames` must outlive this. Names of the two CameraInfo topics, for problem().
  RigAssembler(const FrameTree& frames, std::string left_topic, std::string right_topic);

  /// A complete calibration of another frame holds no longer.
  void setImuFrame(const std::string& imu_frame);
  void addLeft(const sensor_msgs::CameraInfo& info);
  void addRight(const sensor_msgs::CameraInfo& info);
  /// `frames` has changed.
  void noteTransforms();

  const std::optional<StereoRig>& rig() const { return rig_; }
  /// What is missing or wrong, as a sentence that names topics and frames; empty once the rig is known.
  const std::string& problem() const { return problem_; }
  /// Left optical frame; empty as long as there is no left CameraInfo.
  const std::string& leftFrame() const { return left_frame_; }
  /// Of the images, where both CameraInfo state the same one, and no lens that shows more than it.
  std::optional<ImageSize> imageSize() const;
  /// What came later and contradicts the calibration in use; empty: nothing.
  const std::string& changedLater() const { return changed_later_; }

 private:
  void update();
  void noteChange(const std::optional<sensor_msgs::CameraInfo>& held, const sensor_msgs::CameraInfo& info);
  std::string transformProblem(SE3& cam_T_imu) const;

  const FrameTree& frames_;
  std::string left_topic_;
  std::string right_topic_;
  std::string imu_frame_;
  std::string left_frame_;
  std::optional<sensor_msgs::CameraInfo> left_;
  std::optional<sensor_msgs::CameraInfo> right_;
  std::optional<StereoRig> rig_;
  std::string problem_;
  std::string changed_later_;
};

} // namespace vi_ekf_slam

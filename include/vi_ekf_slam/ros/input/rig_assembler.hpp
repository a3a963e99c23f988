#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <optional>
#include <string>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/ros/input/feature_screen.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"

namespace vi_ekf_slam {

/// Puts the calibration together from what ROS carries: two CameraInfo messages of a RECTIFIED pair (only P
/// counts) and the transform from the IMU to the left optical frame. The first complete calibration holds.
///
/// As in stereo_image_proc, the left CameraInfo's frame_id is taken as the frame of the rectified left image.
class RigAssembler {
 public:
  /// `frames` must outlive this. Names of the two CameraInfo topics, for problem().
  RigAssembler(const FrameTree& frames, std::string left_topic, std::string right_topic);

  void setImuFrame(const std::string& imu_frame);
  void addLeft(const sensor_msgs::CameraInfo& info);
  void addRight(const sensor_msgs::CameraInfo& info);
  /// `frames` has changed.
  void noteTransforms() { update(); }

  const std::optional<StereoRig>& rig() const { return rig_; }
  /// What is missing or wrong, as a sentence that names topics and frames; empty once the rig is known.
  const std::string& problem() const { return problem_; }
  /// Left optical frame; empty as long as there is no left CameraInfo.
  const std::string& leftFrame() const { return left_frame_; }
  /// Of the images, where both CameraInfo state the same one.
  std::optional<ImageSize> imageSize() const;
  /// Whether a CameraInfo that came later contradicts the calibration in use.
  bool changedLater() const { return changed_later_; }

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
  bool changed_later_ = false;
};

} // namespace vi_ekf_slam

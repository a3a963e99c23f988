#include "vi_ekf_slam/front_end/stereo_calibration.hpp"

namespace vi_ekf_slam {

StereoCalibration rectifiedCalibration(const StereoCamera& camera, cv::Size size) {
  CameraModel::Parameters parameters;
  parameters.size = size;
  parameters.K = parameters.P = {camera.fu, 0.0, camera.cu, 0.0, camera.fv, camera.cv, 0.0, 0.0, 1.0};
  parameters.images_are_rectified = true;
  return {CameraModel(parameters), CameraModel(parameters), camera};
}

} // namespace vi_ekf_slam

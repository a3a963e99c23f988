#pragma once

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/front_end/camera_model.hpp"

namespace vi_ekf_slam {

/// The stereo pair as the front end needs it. The rectified images of both have the same focal lengths and
/// principal point.
struct StereoCalibration {
  CameraModel left, right;
  StereoCamera camera; ///< the rectified pair
};

} // namespace vi_ekf_slam

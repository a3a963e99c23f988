#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam::paper {

/// px; no image is that wide, and the square of a pixel far beyond it overflows.
constexpr double kMaxPixel = 1e6;

/// Whether four numbers can be pixels at all: finite and none beyond `kMaxPixel` on either side.
bool isPlausible(const StereoPixels& pixels);

/// z~ and its derivatives at the state (U, m), eq. 15, 16 and 19.
struct PredictedObservation {
  StereoPixels pixels;                     ///< M pi(cam_T_imu U m), px
  Eigen::Matrix<double, 4, 3> by_landmark; ///< eq. 15, world axes
  Eigen::Matrix<double, 4, 6> by_pose;     ///< eq. 19, for U = Exp(delta) U^
};

/// Predicts what the pair sees of the point `landmark_world` (m). Nothing when it is nearer than
/// `min_depth_m`.
std::optional<PredictedObservation> predictObservation(const StereoRig& rig, const SE3& imu_T_world,
                                                       const Eigen::Vector3d& landmark_world,
                                                       double min_depth_m);

/// First-observation initialisation (eq. 6 to 8): the world point behind four pixels. Nothing when the
/// disparity is not positive or the depth is outside [min_depth_m, max_depth_m].
std::optional<Eigen::Vector3d> initialLandmark(const StereoRig& rig, const SE3& imu_T_world,
                                               const StereoPixels& pixels, const PaperConfig& config);

/// Whether an id belongs to the share `fraction` of all ids that is used. Evenly spread: of any 1 / fraction
/// consecutive ids one is in.
bool isSelected(FeatureId id, double fraction);

} // namespace vi_ekf_slam::paper

#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"

/// The paper's models: how the pose moves, what the pair sees, and which landmarks there are.
namespace vi_ekf_slam::paper {

/// Transition of the error delta over `tau` s under the twist u: exp(-tau u^curlywedge), 6x6 (eq. 10).
Matrix6d errorTransition(const Vector6d& twist, double tau);

/// EKF prediction (eq. 11) of the inverse pose U = imu_T_world: mean exp(-tau u^) U, covariance
/// F Sigma F^T + W of delta = (translation, rotation) along the IMU's axes, U = Exp(delta) U^, where W is the
/// 6x6 of this step.
void predict(const Vector6d& twist, double tau, const Matrix6d& W, SE3& imu_T_world,
             Eigen::Ref<Matrix6d> covariance);

/// Whether four numbers can be pixels at all: finite, and none beyond 1e6 px on either side.
bool isPlausible(const StereoPixels& pixels);

/// z~ and its derivatives at the state (U, m), eq. 15, 16 and 19.
struct PredictedObservation {
  StereoPixels pixels;                     ///< M pi(cam_T_imu U m), px
  Eigen::Matrix<double, 4, 3> by_landmark; ///< eq. 15, world axes
  Eigen::Matrix<double, 4, 6> by_pose;     ///< eq. 19, for U = Exp(delta) U^
};

/// What the pair sees of the point `landmark_world` (m). Nothing when it is nearer than `min_depth_m`.
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

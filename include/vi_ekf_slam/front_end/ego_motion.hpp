#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/geometry/camera.hpp"

namespace vi_ekf_slam {

constexpr std::size_t kFewestForMotion = 8; ///< points that agree

/// A point of the static world in the pair before, and where the left camera sees it now; rectified pixels.
struct Displacement {
  Eigen::Vector3d before; ///< m, in the rectified left camera of the pair before
  Eigen::Vector2d now;    ///< px
};

/// The point behind a left pixel and its disparity, m; points at infinity are put far away.
Eigen::Vector3d pointBehind(const StereoCamera& camera, const cv::Point2d& left, double disparity);
/// Its disparity, px, for one before the camera.
double disparityOf(const StereoCamera& camera, const Eigen::Vector3d& point);

/// now_T_before of the rectified left camera: Gauss-Newton on the pixels' distances, beginning at `guess`, in
/// which those that do not fit lose their weight (Geman and McClure), the sooner the better the guess is.
/// Nothing where too few agree.
///
/// Where a gyro has told the rotation, it is that of `told`, whose translation is guessed: the motion that
/// turns so is taken where one that is free to turn contradicts it and fits worse, or is not found. Something
/// near that moves and fills half of the picture can be made to fit, nearly and together with the world, by a
/// turn that is none.
std::optional<SE3> estimateMotion(const StereoCamera& camera, const std::vector<Displacement>& displacements,
                                  const SE3& guess, const std::optional<SE3>& told = {});

/// px, how far the point is from where the motion puts it, at least: its disparity may be off, too, by as
/// much.
double misfit(const StereoCamera& camera, const Displacement& displacement, const SE3& now_T_before);

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/observation/rig_variables.hpp"
#include "vi_ekf_slam/core/observation/scene_disparities.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// A rectified pair measures three things of a point, (u_left, v, u_right) with v the mean of both rows. With
/// q = C R^T (x - p) + t in the left camera's frame, cam_T_imu = (C, t), q moves by C R^T y alone: how the
/// world is turned or shifted does not appear.
class StereoModel {
 public:
  struct Options {
    double pixel_sigma = 1.0;    ///< px, of each of the four coordinates of a feature
    double min_disparity = 1.0;  ///< px, where a landmark starts
    bool unbiased_starts = true; ///< (for comparison: false)
    double min_depth_m = 0.5;    ///< m; nearer points are not predicted
    double max_depth_m = 220.0;  ///< m; points that start farther away do not become landmarks
  };

  StereoModel(const StereoRig& rig, const Options& options, const RigVariables& variables = {})
      : rig_(rig), options_(options), variables_(variables) {}

  const StereoRig& rig() const { return rig_; }
  const RigVariables& variables() const { return variables_; }
  /// The frame that is looked at from now on: the filter's state is of its stamp, which `time_offset` (s) is
  /// part of; what differs from the estimated one the body has moved by its twist (m/s, rad/s, body).
  void beginFrame(double time_offset, const Vector6d& twist) {
    time_offset_ = time_offset;
    twist_ = twist;
  }
  /// From now on landmarks start where the disparities of this frame's `features` put them, until the scene
  /// is forgotten. Nothing changes while there is one.
  void lookAtScene(Filter& filter, const StereoFrame& frame, const std::vector<std::size_t>& features);
  void forgetScene(Filter& filter);
  /// Takes points of the world to the left camera's frame; with `rig_error` added to the calibration.
  SE3 camTWorld(const Filter& filter, const Eigen::VectorXd& rig_error = {}) const;

  // Of a feature: its pixels, and their standard deviation in px; 0: as configured.

  /// Whether the pixels are those of a point before the pair.
  bool isUsable(const StereoPixels& pixels, double sigma = 0.0) const;

  /// What `pixels` say about the landmark; nothing when it is not before the camera.
  std::optional<LinearMeasurement> observe(const Filter& filter, Handle landmark, const StereoPixels& pixels,
                                           double sigma = 0.0) const;

  /// Where a feature seen for the first time lies: y = noise (3x3, m^2, world axes) and what `by` has it. Not
  /// the point of its pixels but the one that tells distances without bias.
  struct Triangulated {
    Eigen::Vector3d position; ///< m, world
    Eigen::Matrix3d noise;
    LinearFunction by;
  };
  /// Nothing when the depth is outside [min_depth_m, max_depth_m].
  std::optional<Triangulated> triangulate(const Filter& filter, const StereoPixels& pixels,
                                          double sigma = 0.0) const;

  double sigmaOf(double given) const { return given > 0.0 ? given : options_.pixel_sigma; }
  /// 3x3 of (u_left, v, u_right), px^2.
  Eigen::Matrix3d noise(double sigma = 0.0) const;

  /// Of y of a landmark, along the world axes (m^2), whose track has slid by `sigma` px along rows and
  /// columns, alike in both images: at the same depth.
  Eigen::Matrix3d slideNoise(const Filter& filter, Handle landmark, double sigma) const;

  /// Corrects points before the camera in (x/z, y/z, 1/z), where pixels are linear, and re-expresses the
  /// error so that its covariance in these coordinates is unchanged: with straight ones the noise of far
  /// points' depth turns into an error of scale. Of the state before the correction, whose `error` it is;
  /// without calibration variables it need not be known.
  PointChart inverseDepthChart(const Filter& filter, const Eigen::VectorXd& error = {}) const;

 private:
  StereoPixels withoutBias(const StereoPixels& pixels, double sigma) const;

  StereoRig rig_;
  Options options_;
  RigVariables variables_;
  double time_offset_ = 0.0;
  Vector6d twist_ = Vector6d::Zero();
  std::optional<SceneDisparities> scene_;
};

} // namespace vi_ekf_slam

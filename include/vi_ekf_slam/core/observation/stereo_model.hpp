#pragma once

#include <Eigen/Core>
#include <optional>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/geometry/camera.hpp"

namespace vi_ekf_slam {

/// A rectified pair measures three things of a point, (u_left, v, u_right) with v the mean of both rows. With
/// q = C R^T (x - p) + t in the left camera's frame, cam_T_imu = (C, t), q moves by C R^T y alone: how the
/// world is turned or shifted does not appear.
class StereoModel {
 public:
  static constexpr const char* kScaleName = "scale"; ///< of the baseline's scale, in a saved map

  struct Options {
    double pixel_sigma = 1.0;    ///< px, of each of the four coordinates of a feature
    double min_disparity = 1.0;  ///< px
    bool unbiased_starts = true; ///< (for comparison: false)
    double min_depth_m = 0.5;    ///< m; nearer points are not predicted
    double max_depth_m = 220.0;  ///< m; points that start farther away do not become landmarks
  };

  /// `scale`: a variable of one row, the relative error of the baseline; none: the baseline is known.
  StereoModel(const StereoRig& rig, const Options& options, std::optional<Handle> scale)
      : rig_(rig), options_(options), scale_(scale) {}

  const StereoRig& rig() const { return rig_; }
  /// Takes points of the world to the left camera's frame.
  SE3 camTWorld(const Filter& filter) const { return rig_.cam_T_imu * filter.pose().inverse(); }

  /// Whether the pixels are those of a point before the pair.
  bool isUsable(const StereoPixels& pixels) const;

  /// What `pixels` say about the landmark; nothing when it is not before the camera.
  std::optional<LinearMeasurement> observe(const Filter& filter, Handle landmark,
                                           const StereoPixels& pixels) const;

  /// Where a feature seen for the first time lies: y = noise (3x3, m^2, world axes) and what `by` has it. Not
  /// the point of its pixels but the one that tells distances without bias.
  struct Triangulated {
    Eigen::Vector3d position; ///< m, world
    Eigen::Matrix3d noise;
    LinearFunction by;
  };
  /// Nothing when the depth is outside [min_depth_m, max_depth_m].
  std::optional<Triangulated> triangulate(const Filter& filter, const StereoPixels& pixels) const;

  /// 3x3 of (u_left, v, u_right), px^2.
  Eigen::Matrix3d noise() const;

  /// Corrects points before the camera in (x/z, y/z, 1/z), where pixels are linear, and re-expresses the
  /// error so that its covariance in these coordinates is unchanged: with straight ones the noise of far
  /// points' depth turns into an error of scale. Of the pose before the correction.
  PointChart inverseDepthChart(const Filter& filter) const;

 private:
  StereoPixels withoutBias(const StereoPixels& pixels) const;
  StereoCamera cameraOf(const Filter& filter) const;

  StereoRig rig_;
  Options options_;
  std::optional<Handle> scale_;
};

} // namespace vi_ekf_slam

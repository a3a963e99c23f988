#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/geometry/se3.hpp"

namespace vi_ekf_slam::simulation {

/// A lap round a rectangular block: a rounded rectangle about the origin, driven counter-clockwise.
/// The path frame has x along the length, y along the width, z up, and the street at the height `height(s)`.
class BlockPath {
 public:
  /// Sides in m, each at least four corner radii.
  BlockPath(double length, double width);

  double length() const { return length_; }
  double width() const { return width_; }
  /// m
  double perimeter() const { return perimeter_; }

  /// Point of the path at station `s` in m (any real number; laps repeat), at z = 0.
  Eigen::Vector2d point(double s) const;
  /// Height of the street in m above the path frame's origin.
  double height(double s) const;
  /// m from station `s` to the next corner; 0 inside one.
  double distanceToCorner(double s) const;

  /// Pose of a car's IMU, which rides 0.93 m above the street: heading along the chord of its wheelbase, so
  /// that the yaw rate is continuous; pitch along the slope; a little sway.
  SE3 path_T_imu(double s) const;

 private:
  double wrapped(double s) const;

  double length_, width_, perimeter_;
};

} // namespace vi_ekf_slam::simulation

#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// Sums of sinusoids, one sum a coordinate, whose periods all divide kPeriod.
class Waves {
 public:
  static constexpr double kPeriod = 120.0; ///< s

  /// Of a coordinate: `count` sinusoids of random phase, from `slowest` to `fastest` Hz. Their amplitudes are
  /// uniform in [low, high] for derivative number `order` (0, 1 or 2) of the coordinate, so 0.5 and 1 with
  /// order 2 are m/s^2.
  struct Band {
    int count = 0;
    double slowest = 0.0, fastest = 0.0, low = 0.0, high = 0.0;
    int order = 0;
  };

  void add(Eigen::Index coordinate, const Band& band, Random& random);
  void scale(double factor);
  CoordinateMotion at(double t) const;

 private:
  struct Wave {
    Eigen::Index coordinate;
    double amplitude, omega, phase;
  };
  std::vector<Wave> waves_;
};

/// A camera in somebody's hand, or on a drone, in a room: it wanders and looks about slowly, and is shaken in
/// bursts, up to `peak_acceleration` (m/s^2) and `peak_rate` (rad/s) and on the whole far less. All
/// derivatives are continuous. With a standing start it rests first and then leaves smoothly. After two
/// minutes the motion repeats.
class HandheldTrajectory : public Trajectory {
 public:
  explicit HandheldTrajectory(const DriveOptions& options);
  Kinematics at(double t) const override;
  /// Of all its positions, m.
  const Eigen::AlignedBox3d& extent() const { return extent_; }

 private:
  struct Burst {
    double omega = 0.0, phase = 0.0;
  };
  CoordinateMotion shaken(double t) const;
  CoordinateMotion unwarped(double t) const;
  void limitAcceleration(double limit);
  void limitRate(double limit);
  void leaveSmoothly(double limit);

  Waves slow_position_, slow_angles_, fast_position_, fast_angles_;
  Burst position_burst_, angle_burst_;
  double rest_;
  double leaving_ = 0.0; ///< s from rest to full motion
  Eigen::AlignedBox3d extent_;
};

} // namespace vi_ekf_slam::simulation

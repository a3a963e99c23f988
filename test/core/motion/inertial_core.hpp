#pragma once

#include "../filter/states.hpp"
#include "vi_ekf_slam/core/motion/inertial.hpp"

/// Filters whose body moves by its IMU.
namespace vi_ekf_slam::test {

constexpr double kGravity = 9.81;

Inertial::Options withoutImuNoise(Inertial::Options options = {});

ImuSample imuSample(double t, const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration);

/// An IMU that reads the same from time 0 s to `until`.
ImuTrack steadyImu(const Inertial::Options& options, const Eigen::Vector3d& rate,
                   const Eigen::Vector3d& acceleration, double until);

/// A filter of the fifteen errors (dp, theta, e_v, db_g, db_a), and points behind them; of 24 with `scale`,
/// the accelerometer's.
struct InertialScene {
  explicit InertialScene(Inertial::Options options = withoutImuNoise(), const SE3& pose = SE3(),
                         bool scale = false)
      : filter(pose, Matrix6d::Identity()), motion(withScale(std::move(options), scale)) {
    motion.addTo(filter);
    filter.closeCore();
  }

  static Inertial::Options withScale(Inertial::Options options, bool scale) {
    if (!scale) options.accelerometer_scale_sigma = 0.0;
    return options;
  }
  Eigen::Vector3d velocity() const { return filter.variables().mean(handleOf(filter, Inertial::kVelocity)); }
  /// Moves on in `steps` steps.
  void propagate(const ImuTrack& imu, double from, double to, int steps = 1) {
    for (int i = 0; i < steps; ++i)
      motion.propagate(filter, imu, fromSeconds(from + (to - from) * i / steps),
                       fromSeconds(from + (to - from) * (i + 1) / steps));
  }

  Filter filter;
  Inertial motion;
};

/// Anywhere, turned and moving in any way, with biases.
InertialScene randomInertial(Random& random, const Inertial::Options& options = withoutImuNoise(),
                             bool scale = false);

/// Directions of the error that shift the world and turn it about the vertical through its origin.
Eigen::MatrixXd levelGaugeOf(const Filter& filter);

} // namespace vi_ekf_slam::test

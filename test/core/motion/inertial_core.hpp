#pragma once

#include "../filter/states.hpp"
#include "vi_ekf_slam/core/motion/inertial.hpp"

/// Filters whose body moves by its IMU.
namespace vi_ekf_slam::test {

constexpr double kGravity = 9.81;

inline Inertial::Options withoutImuNoise(Inertial::Options options = {}) {
  options.noise = {0.0, 0.0, 0.0, 0.0};
  options.noise_given = true;
  return options;
}

inline ImuSample imuSample(double t, const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration) {
  ImuSample sample;
  sample.stamp = fromSeconds(t);
  sample.angular_velocity = rate;
  sample.acceleration = acceleration;
  return sample;
}

/// An IMU that reads the same from time 0 s to `until`.
inline ImuTrack steadyImu(const Inertial::Options& options, const Eigen::Vector3d& rate,
                          const Eigen::Vector3d& acceleration, double until) {
  ImuTrack imu(options.noise, options.noise_given);
  imu.reach(imuSample(0.0, rate, acceleration));
  imu.expect(imuSample(until, rate, acceleration));
  return imu;
}

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
  Eigen::Vector3d velocity() const { return filter.variables().mean(motion.velocityVariable()); }
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
inline InertialScene randomInertial(Random& random, const Inertial::Options& options = withoutImuNoise(),
                                    bool scale = false) {
  InertialScene scene(options, SE3(so3::Exp(random.vector<3>(-2.0, 2.0)), random.vector<3>(-20.0, 20.0)),
                      scale);
  scene.filter.setMean(scene.motion.velocityVariable(), random.vector<3>(-5.0, 5.0));
  scene.filter.setMean(scene.motion.gyroBiasVariable(), random.vector<3>(-0.1, 0.1));
  scene.filter.setMean(scene.motion.accelerometerBiasVariable(), random.vector<3>(-0.5, 0.5));
  if (const auto M = scene.motion.accelerometerScaleVariable())
    scene.filter.setMean(*M, random.vector<9>(-0.02, 0.02));
  return scene;
}

/// Directions of the error that shift the world and turn it about the vertical through its origin.
inline Eigen::MatrixXd levelGaugeOf(const Filter& filter) {
  Eigen::MatrixXd N(filter.rows(), 4);
  const Eigen::MatrixXd all = gaugeOf(filter);
  N << all.leftCols(3), all.col(5);
  return N;
}

} // namespace vi_ekf_slam::test

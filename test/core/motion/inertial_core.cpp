#include "inertial_core.hpp"

namespace vi_ekf_slam::test {

Inertial::Options withoutImuNoise(Inertial::Options options) {
  options.noise = {0.0, 0.0, 0.0, 0.0};
  options.noise_given = true;
  return options;
}

ImuSample imuSample(double t, const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration) {
  ImuSample sample;
  sample.stamp = fromSeconds(t);
  sample.angular_velocity = rate;
  sample.acceleration = acceleration;
  return sample;
}

ImuTrack steadyImu(const Inertial::Options& options, const Eigen::Vector3d& rate,
                   const Eigen::Vector3d& acceleration, double until) {
  ImuTrack imu(options.noise, options.noise_given);
  imu.reach(imuSample(0.0, rate, acceleration));
  imu.expect(imuSample(until, rate, acceleration));
  return imu;
}

InertialScene randomInertial(Random& random, const Inertial::Options& options, bool scale) {
  InertialScene scene(options, SE3(so3::Exp(random.vector<3>(-2.0, 2.0)), random.vector<3>(-20.0, 20.0)),
                      scale);
  scene.filter.setMean(handleOf(scene.filter, Inertial::kVelocity), random.vector<3>(-5.0, 5.0));
  scene.filter.setMean(handleOf(scene.filter, Inertial::kGyroBias), random.vector<3>(-0.1, 0.1));
  scene.filter.setMean(handleOf(scene.filter, Inertial::kAccelerometerBias), random.vector<3>(-0.5, 0.5));
  if (const auto M = scene.filter.variables().find(Inertial::kAccelerometerScale))
    scene.filter.setMean(*M, random.vector<9>(-0.02, 0.02));
  return scene;
}

Eigen::MatrixXd levelGaugeOf(const Filter& filter) {
  Eigen::MatrixXd N(filter.rows(), 4);
  const Eigen::MatrixXd all = gaugeOf(filter);
  N << all.leftCols(3), all.col(5);
  return N;
}

} // namespace vi_ekf_slam::test

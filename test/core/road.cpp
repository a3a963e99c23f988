#include "road.hpp"

namespace vi_ekf_slam::test {

InvariantConfig steadyTracks() {
  InvariantConfig config;
  config.motion.velocity_sigma = kTypical.velocity;
  config.motion.gyro_sigma = kTypical.gyro;
  config.slip.sigma = 0.0;
  return config;
}

InvariantEstimator withRig(const InvariantConfig& config) {
  InvariantEstimator estimator(config);
  estimator.setRig(exampleRig());
  return estimator;
}

double positionError(const Estimator& estimator, const SE3& truth) {
  return (estimator.state().world_T_imu.translation() - truth.translation()).norm();
}

double rotationError(const Estimator& estimator, const SE3& truth) {
  return so3::Log(estimator.state().world_T_imu.rotation() * truth.rotation().transpose()).norm();
}

void expectSame(const StateEstimate& a, const StateEstimate& b, double tolerance) {
  EXPECT_EQ(a.stamp, b.stamp);
  EXPECT_LE(distance(a.world_T_imu.matrix(), b.world_T_imu.matrix()), tolerance);
  EXPECT_LE(distance(a.twist, b.twist), tolerance);
  EXPECT_LE(distance(a.pose_covariance, b.pose_covariance), tolerance);
  EXPECT_LE(distance(a.twist_covariance, b.twist_covariance), tolerance);
}

bool isPositiveDefinite(const Matrix6d& P) {
  return P.allFinite() && distance(P, P.transpose()) <= 1e-9 * P.cwiseAbs().maxCoeff() && isPositive(P);
}

InvariantEstimator driven(Road& road, int frames, const InvariantConfig& config) {
  InvariantEstimator estimator = withRig(config);
  for (int i = 0; i < frames; ++i) road.feed(estimator);
  return estimator;
}

Ahead ahead(Road& road, int frames, const InvariantConfig& config) {
  Ahead result{driven(road, frames, config), {}};
  road.feedSamples(result.estimator);
  result.frame = road.frame();
  return result;
}

StateEstimate predicted(InvariantEstimator estimator, const StereoFrame& frame) {
  estimator.process(StereoFrame{frame.stamp, {}});
  return estimator.state();
}

} // namespace vi_ekf_slam::test

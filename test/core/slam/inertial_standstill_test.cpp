// How an inertial estimate stands.

#include <Eigen/Eigenvalues>

#include "../flight.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(InertialStandstill, DoesNotDriftAndLearnsTheGyrosBias) {
  FlightOptions options = startFlight(true);
  options.imu_rate = 400.0;
  options.pixel = 0.1;
  options.points = 60;
  options.noise.gyro_walk = 1e-6;
  Flight flight(5, options);
  InertialEstimator estimator = inertialEstimator(inertialConfig(options));
  startOf(flight, estimator);
  ASSERT_TRUE(estimator.hasStarted()) << estimator.startProblem();
  const SE3 begin = estimator.state().world_T_imu;
  while (flight.seconds() < 60.0) ASSERT_EQ(flight.feed(estimator).divergence, Divergence::kNone);
  const StateEstimate state = estimator.state();
  EXPECT_LT((state.world_T_imu.translation() - begin.translation()).norm(), 0.01);
  EXPECT_LT(so3::Log(begin.rotation().transpose() * state.world_T_imu.rotation()).norm(), 0.01);
  EXPECT_LT(state.twist.head<3>().norm(), 5e-3);
  EXPECT_LT(std::sqrt(state.twist_covariance.diagonal().head<3>().maxCoeff()), 0.01);
  const SavedMap map = estimator.savedMap()();
  const Eigen::Vector3d error = savedVariable(map, Inertial::kGyroBias) - flight.gyroBias();
  const Eigen::Vector3d sigma = map.covariance.diagonal().segment<3>(9).cwiseSqrt();
  EXPECT_LT(error.norm(), 5e-4);
  EXPECT_LT(sigma.maxCoeff(), 5e-4);
  EXPECT_LT(error.cwiseQuotient(sigma).norm(), 4.5);
}

// At rest tilt and the accelerometer's bias are one for all that is measured.
TEST(InertialStandstill, LearnsNoTiltThatNothingTells) {
  FlightOptions options = startFlight(true);
  options.pixel = 0.1;
  options.noise = {2e-4, 2e-3, 2e-5, 1e-3};
  for (unsigned seed = 0; seed < 4; ++seed) {
    Flight flight(seed, options);
    InvariantConfig config = inertialConfig(options, options.pixel);
    config.inertial.accelerometer_scale_sigma = 0.01;
    InertialEstimator estimator = inertialEstimator(config);
    startOf(flight, estimator);
    ASSERT_TRUE(estimator.hasStarted()) << estimator.startProblem();
    const auto tilt = [&]() -> Eigen::Matrix2d {
      return estimator.state().pose_covariance.block<2, 2>(3, 3);
    };
    const auto up = [&]() -> Eigen::Vector3d {
      return estimator.state().world_T_imu.rotation().transpose().col(2);
    };
    while (flight.seconds() < 3.0) flight.feed(estimator);
    const double known = std::sqrt(tilt().selfadjointView<Eigen::Lower>().eigenvalues()[0]);
    double step = 0.0;
    while (flight.seconds() < 60.0) {
      const Eigen::Vector3d before = up();
      flight.feed(estimator);
      step = std::max(step, before.cross(up()).norm());
    }
    EXPECT_GT(std::sqrt(tilt().selfadjointView<Eigen::Lower>().eigenvalues()[0]), 0.95 * known) << seed;
    EXPECT_LT(step, 2e-3) << seed << ": rad in a frame";
  }
}

} // namespace
} // namespace vi_ekf_slam::test

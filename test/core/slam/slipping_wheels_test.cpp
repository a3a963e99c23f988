// Velocities of wheels that slip or are blocked for seconds, while the pictures are sound.

#include <vector>

#include "../flight.hpp"
#include "../road.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kMost = 22.46; // chi-square, 6 degrees of freedom, 99.9 %

double neesOf(const SE3& truth, const StateEstimate& state) {
  Vector6d error;
  error << truth.translation() - state.world_T_imu.translation(),
      so3::Log(truth.rotation() * state.world_T_imu.rotation().transpose());
  return squaredMahalanobis(error, state.pose_covariance);
}

TEST(SlippingWheels, DoNotMoveACarWithGyroAndVelocity) {
  for (const double factor : {1.0, 2.0, 0.0, -1.0}) {
    Road road(1, 60, {0.1, 0.01, 0.7});
    InvariantConfig config = steadyTracks();
    config.motion.velocity_sigma = 0.1;
    config.motion.gyro_sigma = 0.01;
    InvariantEstimator estimator = driven(road, 50, config);
    std::size_t contradicting = 0;
    for (int i = 0; i < 50; ++i) {
      estimator.process(road.gyro());
      VelocitySample slipping = road.velocity();
      slipping.linear_velocity *= factor;
      estimator.process(slipping);
      contradicting += estimator.process(road.frame()).contradicting_velocities;
      if (i + 1 < 50) road.move();
    }
    EXPECT_EQ(contradicting, factor == 1.0 ? 0u : 50u) << factor;
    EXPECT_LT(neesOf(road.pose(), estimator.state()), kMost) << factor;
  }
}

TEST(SlippingWheels, DoNotMoveABodyWithAnIMU) {
  FlightOptions options;
  options.imu_rate = 100.0;
  options.noise = {1e-3, 1e-2, 1e-4, 1e-3};
  options.pixel = 0.5;
  options.points = 80;
  Eigen::Matrix<double, 15, 1> sigma;
  sigma << 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02;
  for (const double factor : {1.0, 2.0, 0.0}) {
    Flight flight(5, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options));
    estimator.begin(flight.initialState(sigma, Eigen::Matrix<double, 15, 1>::Zero()));
    std::size_t contradicting = 0;
    while (flight.seconds() < 10.0) {
      flight.feedSample(estimator, [](auto&) {});
      for (int i = 1; i < 10; ++i) flight.feedSample(estimator, [](auto&) {});
      const double t = flight.lastSeconds(), slips = t < 4.0 ? 1.0 : factor;
      const Eigen::Vector3d v = flight.pose(t).rotation().transpose() * flight.velocity(t);
      StereoFrame frame = flight.frame();
      estimator.process(
          VelocitySample{frame.stamp, slips * v + flight.random().gaussian<3>(0.1), isotropic(0.1)});
      contradicting += estimator.process(frame).contradicting_velocities;
    }
    EXPECT_EQ(contradicting > 0, factor != 1.0) << factor;
    EXPECT_LT(neesOf(flight.pose(flight.lastSeconds()), estimator.state()), kMost) << factor;
  }
}

} // namespace
} // namespace vi_ekf_slam::test

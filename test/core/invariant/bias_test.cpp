#include <algorithm>
#include <cmath>

#include "road.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(Bias, OfABetterSensorIsSmallerAsTheSquareOfItsNoise) {
  InvariantConfig config;
  config.prior_twist_sigma.setConstant(10.0);
  config.prior_bias_sigma << 0.2, 0.3, 0.4, 0.02, 0.03, 0.04;
  for (const double grade : {0.01, 0.2, 0.7, 1.0, 3.0}) {
    InvariantEstimator estimator(config);
    estimator.process(GyroSample{1, Eigen::Vector3d::Zero(), isotropic(grade * config.gyro_sigma)});
    estimator.process(VelocitySample{1, Eigen::Vector3d::Zero(), isotropic(grade * config.velocity_sigma)});
    const double share = std::min(1.0, grade * grade); // a worse sensor keeps the bias that is configured
    for (int i = 0; i < 6; ++i) {
      const double noise = grade * (i < 3 ? config.velocity_sigma : config.gyro_sigma);
      const double bias = share * config.prior_bias_sigma[i];
      // A first sample leaves of the prior 100 what its noise and bias leave.
      const double expected = 100.0 * (1.0 - 100.0 / (100.0 + noise * noise + bias * bias));
      EXPECT_NEAR(estimator.state().twist_covariance(i, i), expected, 1e-12) << grade << " " << i;
    }
  }
}

TEST(Bias, IsGradedByTheFirstSampleAlone) {
  // A sensor that says later that it is better has not lost what was learnt of it.
  InvariantConfig config;
  InvariantEstimator once(config), twice(config);
  for (InvariantEstimator* estimator : {&once, &twice}) {
    estimator->process(GyroSample{1, Eigen::Vector3d::Zero(), isotropic(config.gyro_sigma)});
  }
  twice.process(GyroSample{1, Eigen::Vector3d::Zero(), isotropic(1e-4)});
  // The bias is as wide as it was, so the second sample tells the rate to no better than 0.01 rad/s.
  EXPECT_GT(twice.state().twist_covariance(5, 5), 0.9 * 1e-4);
  EXPECT_LT(twice.state().twist_covariance(5, 5), once.state().twist_covariance(5, 5));
}

TEST(Bias, IsConfiguredWhereTheMessagesAreSilent) {
  InvariantConfig config;
  config.prior_twist_sigma.setConstant(10.0);
  InvariantEstimator estimator(config);
  estimator.process(GyroSample{1, Eigen::Vector3d::Zero(), {}});
  EXPECT_NEAR(estimator.state().twist_covariance(5, 5), 100.0 - 1e4 / (100.0 + 0.05 * 0.05 + 0.01 * 0.01),
              1e-12);
}

/// What the filter takes the rate for, rad/s, when a gyro without noise reads `bias` after `standing` s at
/// rest.
Eigen::Vector3d rateAfterStanding(Road& road, double standing, const Eigen::Vector3d& bias,
                                  const InvariantConfig& config) {
  road.setTwist(Vector6d::Zero());
  road.setGyroBias(bias);
  InvariantEstimator estimator = driven(road, static_cast<int>(10.0 * standing), config);
  for (int i = 0; i < 30; ++i) { // so many that the state follows the reading
    GyroSample gyro = road.gyro();
    gyro.angular_velocity = bias;
    estimator.process(gyro);
    road.move();
  }
  return estimator.state().twist.tail<3>();
}

/// RMS over axes and 20 seeds, rad/s.
double biasLeft(double standing, std::size_t features, const InvariantConfig& config) {
  const Eigen::Vector3d bias(0.015, -0.02, 0.018);
  double left = 0.0;
  constexpr unsigned kRuns = 20;
  for (unsigned run = 0; run < kRuns; ++run) {
    Road road(200 + run, features, {config.velocity_sigma, config.gyro_sigma, 0.2});
    left += rateAfterStanding(road, standing, bias, config).squaredNorm() / (3.0 * kRuns);
  }
  return std::sqrt(left);
}

TEST(Bias, IsLearntByStanding) {
  // n samples of noise s beside a prior p leave 1 / sqrt(n / s^2 + 1 / p^2): of 20 s at 10 Hz 3.3 mrad/s.
  EXPECT_LT(biasLeft(20.0, 20, {}), 1.3 * 0.0033);
  // Nor does it take a picture, where the odometer is good.
  InvariantConfig good;
  good.velocity_sigma = 0.1;
  EXPECT_LT(biasLeft(20.0, 0, good), 1.3 * 0.0033);
}

TEST(Bias, IsNotLearntWithoutStanding) {
  InvariantConfig good;
  good.velocity_sigma = 0.1;
  EXPECT_GT(biasLeft(0.5, 0, good), 0.014); // the detector has not yet said a word
  good.standstill_px = 0.0;
  EXPECT_GT(biasLeft(20.0, 0, good), 0.014);
}

} // namespace
} // namespace vi_ekf_slam::invariant

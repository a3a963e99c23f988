#include <algorithm>
#include <cmath>

#include "../road.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(Bias, IsAsWideAsItIsConfiguredForAnySensor) {
  InvariantConfig config = steadyTracks();
  config.motion.prior_twist_sigma.setConstant(10.0);
  config.motion.prior_bias_sigma << 0.2, 0.3, 0.4, 0.02, 0.03, 0.04;
  for (const double grade : {0.01, 0.2, 1.0, 3.0}) {
    InvariantEstimator estimator(config);
    const double velocity = grade * config.motion.velocity_sigma, gyro = grade * config.motion.gyro_sigma;
    estimator.process(ImuSample{1, Eigen::Vector3d::Zero(), isotropic(gyro)});
    estimator.process(VelocitySample{1, Eigen::Vector3d::Zero(), isotropic(velocity)});
    for (int i = 0; i < 6; ++i) {
      const double noise = i < 3 ? velocity : gyro, bias = config.motion.prior_bias_sigma[i];
      // A first sample leaves of the prior 100 what its noise and bias leave.
      const double expected = 100.0 * (1.0 - 100.0 / (100.0 + noise * noise + bias * bias));
      EXPECT_NEAR(estimator.state().twist_covariance(i, i), expected, 1e-12) << grade << " " << i;
    }
  }
}

TEST(Bias, ThatWasLearntIsNotLostWhereASensorSaysThatItIsBetter) {
  const InvariantConfig config = steadyTracks();
  InvariantEstimator once(config), twice(config);
  for (InvariantEstimator* estimator : {&once, &twice}) {
    estimator->process(ImuSample{1, Eigen::Vector3d::Zero(), isotropic(config.motion.gyro_sigma)});
  }
  twice.process(ImuSample{1, Eigen::Vector3d::Zero(), isotropic(1e-4)});
  // The bias is as wide as it was, so the second sample tells the rate to no better than 0.01 rad/s.
  EXPECT_GT(twice.state().twist_covariance(5, 5), 0.9 * 1e-4);
  EXPECT_LT(twice.state().twist_covariance(5, 5), once.state().twist_covariance(5, 5));
}

TEST(Bias, IsConfiguredWhereTheMessagesAreSilent) {
  InvariantConfig config = steadyTracks();
  config.motion.prior_twist_sigma.setConstant(10.0);
  InvariantEstimator estimator(config);
  estimator.process(ImuSample{1, Eigen::Vector3d::Zero(), {}});
  EXPECT_NEAR(estimator.state().twist_covariance(5, 5), 100.0 - 1e4 / (100.0 + 0.05 * 0.05 + 0.01 * 0.01),
              1e-12);
}

/// What the filter takes the rate for, rad/s, when a gyro without noise reads `bias` after `standing` s at
/// rest with `rate` frames a second.
Eigen::Vector3d rateAfterStanding(Road& road, double standing, const Eigen::Vector3d& bias, double rate,
                                  const InvariantConfig& config) {
  road.setTwist(Vector6d::Zero());
  road.setGyroBias(bias);
  InvariantEstimator estimator = driven(road, static_cast<int>(std::lround(rate * standing)), config);
  for (int i = 0; i < 30; ++i) { // so many that the state follows the reading
    ImuSample gyro = road.gyro();
    gyro.angular_velocity = bias;
    estimator.process(gyro);
    road.move();
  }
  return estimator.state().twist.tail<3>();
}

/// RMS over axes and 20 seeds, rad/s. 30 samples a second, and frames as often as `rate` says.
double biasLeft(double standing, std::size_t features, double rate, const InvariantConfig& config) {
  const Eigen::Vector3d bias(0.015, -0.02, 0.018);
  double left = 0.0;
  constexpr unsigned kRuns = 20;
  for (unsigned run = 0; run < kRuns; ++run) {
    Road road(200 + run, features, {config.motion.velocity_sigma, config.motion.gyro_sigma, 0.1});
    road.setRates(rate, static_cast<int>(std::lround(30.0 / rate)));
    left += rateAfterStanding(road, standing, bias, rate, config).squaredNorm() / (3.0 * kRuns);
  }
  return std::sqrt(left);
}

TEST(Bias, IsLearntByStandingAtAnyRateOfTheFrames) {
  // n samples of noise s beside a prior p leave 1 / sqrt(n / s^2 + 1 / p^2): of 20 s at 30 Hz 2 mrad/s.
  for (const double rate : {5.0, 10.0, 30.0}) {
    EXPECT_LT(biasLeft(20.0, 20, rate, {}), 1.3 * 0.0020) << rate;
    // Nor does it take a picture, where the odometer is good.
    InvariantConfig good = steadyTracks();
    good.motion.velocity_sigma = 0.1;
    EXPECT_LT(biasLeft(20.0, 0, rate, good), 1.3 * 0.0020) << rate;
  }
}

TEST(Bias, IsNotLearntWithoutStanding) {
  InvariantConfig good = steadyTracks();
  good.motion.velocity_sigma = 0.1;
  EXPECT_GT(biasLeft(0.5, 0, 10.0, good), 0.014); // the detector has not yet said a word
  good.standstill_px = 0.0;
  EXPECT_GT(biasLeft(20.0, 0, 10.0, good), 0.014);
}

} // namespace
} // namespace vi_ekf_slam

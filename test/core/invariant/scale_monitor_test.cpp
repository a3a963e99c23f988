#include "vi_ekf_slam/core/invariant/scale_monitor.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace vi_ekf_slam::invariant {
namespace {

/// A car at `speed` whose pair sees lengths 1 / (1 + error) of what they are; factor after each sample.
std::vector<double> factors(ScaleMonitor& monitor, double speed, double error, double sigma, int samples,
                            unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  const Eigen::Matrix3d noise = sigma * sigma * Eigen::Matrix3d::Identity();
  std::vector<double> result;
  for (int i = 0; i < samples; ++i) {
    const Eigen::Vector3d truth(speed, 0.1, 0.0);
    const Eigen::Vector3d measured = truth + Eigen::Vector3d(normal(engine), normal(engine), normal(engine));
    const Eigen::Vector3d seen = truth / (1.0 + error) * monitor.factor();
    monitor.compare(measured, noise, seen, 1e-6 * Eigen::Matrix3d::Identity());
    result.push_back(monitor.factor());
  }
  return result;
}

TEST(ScaleMonitor, LeavesAGoodPairAlone) {
  int touched = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    ScaleMonitor monitor(0.02, 4.0);
    const auto all = factors(monitor, 8.0, 0.0, 0.5, 1000, seed);
    if (std::any_of(all.begin(), all.end(), [](double factor) { return factor != 1.0; })) ++touched;
  }
  EXPECT_LE(touched, 2);
}

TEST(ScaleMonitor, FindsAnErrorOfScale) {
  for (const double error : {0.03, -0.03}) {
    for (unsigned seed = 0; seed < 20; ++seed) {
      ScaleMonitor monitor(0.02, 4.0);
      EXPECT_NEAR(factors(monitor, 8.0, error, 0.1, 50, seed).back(), 1.0 + error, 0.01);
      EXPECT_NEAR(factors(monitor, 8.0, error, 0.1, 5000, seed + 100).back(), 1.0 + error, 0.002);
    }
  }
}

TEST(ScaleMonitor, CannotRunAway) {
  for (const double error : {2.0, -0.7}) {
    ScaleMonitor monitor(0.02, 4.0);
    for (const double factor : factors(monitor, 8.0, error, 0.1, 2000, 1)) {
      EXPECT_LE(std::abs(factor - 1.0), 5.0 * 0.02 + 1e-12);
    }
    EXPECT_NEAR(monitor.factor(), error > 0.0 ? 1.1 : 0.9, 1e-9);
  }
}

TEST(ScaleMonitor, IgnoresSlowSpeedsAndAnExactScale) {
  ScaleMonitor slow(0.02, 4.0);
  EXPECT_EQ(factors(slow, 1.9, 0.05, 0.01, 5000, 1).back(), 1.0);
  ScaleMonitor exact(0.0, 4.0);
  EXPECT_EQ(factors(exact, 8.0, 0.05, 0.01, 5000, 1).back(), 1.0);
}

TEST(ScaleMonitor, IsNotPoisonedByAnEstimateThatIsNotFinite) {
  ScaleMonitor monitor(0.02, 4.0);
  const Eigen::Vector3d nan = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  monitor.compare({8.0, 0.0, 0.0}, Eigen::Matrix3d::Identity(), nan, Eigen::Matrix3d::Identity());
  EXPECT_NEAR(factors(monitor, 8.0, 0.03, 0.1, 200, 1).back(), 1.03, 0.01);
}

} // namespace
} // namespace vi_ekf_slam::invariant

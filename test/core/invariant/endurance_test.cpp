#include <algorithm>

#include "road.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

/// Drives `frames` and expects all covariances to be sound.
void driveCheaply(int frames, std::size_t features) {
  Road road(2, features, kTypical);
  InvariantConfig config;
  config.map.max_landmarks = 1000;
  config.map.min_observations = 3;
  InvariantEstimator estimator = makeEstimator(config);
  int unsound = 0;
  std::size_t whole = 0, largest = 0, inactive = 0;
  for (int i = 0; i < frames; ++i) {
    const FrameReport report = road.feed(estimator);
    whole += report.frame_rejected ? 1 : 0;
    largest = std::max(largest, report.landmarks);
    inactive = std::max(inactive, report.inactive);
    if (i % 100 == 0) {
      const StateEstimate state = estimator.state();
      unsound += isPositiveDefinite(state.pose_covariance) ? 0 : 1;
      unsound += isPositiveDefinite(state.twist_covariance) ? 0 : 1;
      unsound += so3::isRotation(state.world_T_imu.rotation(), 1e-12) ? 0 : 1;
    }
  }
  EXPECT_EQ(unsound, 0);
  EXPECT_LE(whole, static_cast<std::size_t>(frames) / 100);
  EXPECT_LE(largest, features);
  EXPECT_LE(inactive, 1000u);
}

TEST(InvariantEstimator, KeepsItsCovarianceSoundOverALongDrive) { driveCheaply(20000, 20); }

TEST(InvariantEstimator, KeepsItsCovarianceSoundOverAMillionFrames) { driveCheaply(1000000, 4); }

} // namespace
} // namespace vi_ekf_slam::invariant

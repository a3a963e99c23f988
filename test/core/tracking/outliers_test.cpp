#include <limits>
#include <set>
#include <variant>
#include <vector>

#include "../road.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

TEST(InvariantEstimator, RejectsAnImpossibleFrameAsAWhole) {
  // Every point where it would be had the car jumped: they agree with each other, and not with the car.
  for (const double jump : {2.5, 4.0}) {
    Road road(4, 30, {0.1, 0.01, 0.7});
    InvariantConfig config = steadyTracks();
    config.motion.velocity_sigma = 0.1;
    config.motion.gyro_sigma = 0.01;
    Ahead now = ahead(road, 50, config);
    const StereoCamera camera = exampleRig().camera;
    for (auto& feature : now.frame.features) {
      const auto q = camera.triangulate(feature.pixels);
      ASSERT_TRUE(q);
      feature.pixels = camera.project(*q + Eigen::Vector3d(0.0, 0.0, jump));
    }
    const StateEstimate expected = predicted(now.estimator, now.frame);
    const FrameReport report = now.estimator.process(now.frame);
    // At the larger jump no feature is plausible by itself, and the frame is rejected feature by feature.
    EXPECT_TRUE(report.frame_rejected || jump > 3.0);
    EXPECT_EQ(report.used, 0u) << jump;
    EXPECT_GE(report.rejected, 20u) << jump;
    EXPECT_EQ(report.nis_dof, 0u);
    expectSame(now.estimator.state(), expected, 0.0);
  }
}

TEST(InvariantEstimator, IsNotMovedByAFrameOfNonsense) {
  for (const bool consensus : {true, false}) {
    Road road(5, 30, kTypical);
    InvariantConfig config = steadyTracks();
    config.update.consensus = consensus;
    Ahead now = ahead(road, 50, config);
    Random random(1);
    for (auto& feature : now.frame.features) {
      const double u = random.uniform(100.0, 1200.0), v = random.uniform(0.0, 370.0);
      feature.pixels = {u, v, u - random.uniform(2.0, 90.0), v};
    }
    const StateEstimate expected = predicted(now.estimator, now.frame);
    const FrameReport report = now.estimator.process(now.frame);
    EXPECT_EQ(report.used, 0u);
    EXPECT_GE(report.rejected, 20u);
    expectSame(now.estimator.state(), expected, 0.0);
  }
}

TEST(InvariantEstimator, FindsOutliers) {
  for (const double share : {0.1, 0.2, 0.3, 0.4}) {
    for (unsigned seed = 0; seed < 10; ++seed) {
      Road road(50 + seed, 40, kTypical);
      Ahead now = ahead(road, 40);
      InvariantEstimator clean = now.estimator;
      const FrameReport without = clean.process(now.frame);
      std::set<FeatureId> known;
      for (const LandmarkEstimate& l : now.estimator.landmarks()) known.insert(l.id);
      Random random(seed);
      const auto wanted = static_cast<std::size_t>(share * 40.0);
      std::size_t outliers = 0, all = 0;
      for (auto& feature : now.frame.features) {
        if (known.count(feature.id) == 0) continue;
        ++all;
        if (outliers == wanted) continue;
        const double along = random.uniform(25.0, 80.0), across = random.uniform(15.0, 40.0);
        const double u = outliers % 2 == 0 ? along : -along;
        feature.pixels += StereoPixels(u, across, u, across);
        ++outliers;
      }
      const FrameReport report = now.estimator.process(now.frame);
      EXPECT_FALSE(report.frame_rejected) << share << " " << seed;
      EXPECT_GE(report.rejected, outliers) << share << " " << seed;
      EXPECT_LE(report.used, all - outliers) << share << " " << seed;
      EXPECT_GE(report.used + outliers + 6, without.used) << share << " " << seed;
      EXPECT_LT(
          distance(now.estimator.state().world_T_imu.translation(), clean.state().world_T_imu.translation()),
          0.1)
          << share << " " << seed;
    }
  }
}

TEST(InvariantEstimator, CountsPixelsThatAreNoneAndIsNotHarmedByThem) {
  Road road(6, 30, kTypical);
  Ahead now = ahead(road, 30);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const std::vector<StereoPixels> bad{
      {nan, 100.0, 90.0, 100.0},   {100.0, nan, 90.0, 100.0},     {100.0, 100.0, infinity, 1.0},
      {1e9, 100.0, 5e8, 100.0},    {100.0, 100.0, 110.0, 100.0},  {100.0, 100.0, 120.0, 100.0},
      {100.0, 100.0, 60.0, 107.0}, {1e300, 1e300, -1e300, 1e300}, {100.0, -1e7, 60.0, -1e7}};
  StereoFrame without = now.frame;
  without.features.erase(without.features.begin(), without.features.begin() + 9);
  for (std::size_t i = 0; i < bad.size(); ++i) now.frame.features[i].pixels = bad[i];
  InvariantEstimator other = now.estimator;
  const FrameReport report = now.estimator.process(now.frame);
  const FrameReport expected = other.process(without);
  EXPECT_EQ(report.invalid, 9u);
  EXPECT_EQ(report.features, 30u);
  EXPECT_EQ(report.used, expected.used);
  EXPECT_EQ(report.landmarks, expected.landmarks);
  expectSame(now.estimator.state(), other.state(), 0.0);
}

TEST(InvariantEstimator, SurvivesIdsThatChangeHands) {
  Road road(11, 30, {0.1, 0.01, 0.3});
  InvariantConfig config = steadyTracks();
  config.motion.velocity_sigma = 0.1;
  config.motion.gyro_sigma = 0.01;
  Ahead now = ahead(road, 50, config);
  InvariantEstimator other = now.estimator;
  other.process(now.frame);
  // Every id now means its neighbour, and goes on to do so.
  const auto swapped = [](StereoFrame frame) {
    const StereoPixels first = frame.features.front().pixels;
    for (std::size_t i = 0; i + 1 < frame.features.size(); ++i) {
      frame.features[i].pixels = frame.features[i + 1].pixels;
    }
    frame.features.back().pixels = first;
    return frame;
  };
  const FrameReport at = now.estimator.process(swapped(now.frame));
  EXPECT_LE(at.used, 2u);
  // One bad frame leaves the local map alone; in the second one all begin anew.
  EXPECT_TRUE(at.frame_rejected);
  EXPECT_EQ(at.initialised, 0u);
  FrameReport last;
  for (int i = 0; i < 3; ++i) {
    road.move();
    const ImuSample gyro = road.gyro();
    const VelocitySample velocity = road.velocity();
    const StereoFrame frame = road.frame();
    for (InvariantEstimator* estimator : {&now.estimator, &other}) {
      estimator->process(gyro);
      estimator->process(velocity);
    }
    other.process(frame);
    last = now.estimator.process(swapped(frame));
    if (i == 0) {
      EXPECT_GE(last.initialised, 25u);
    }
  }
  EXPECT_GE(last.used, 15u);
  EXPECT_LT(
      distance(now.estimator.state().world_T_imu.translation(), other.state().world_T_imu.translation()),
      0.1);
}

TEST(InvariantEstimator, SurvivesStaleFrames) {
  simulation::DriveOptions options;
  options.duration = 60.0;
  simulation::DriveSimulator simulator(options);
  InvariantEstimator estimator(steadyTracks());
  estimator.setRig(simulator.rig());
  std::size_t stale = 0, stale_used = 0, fresh_rejected = 0, fresh = 0;
  while (const auto step = simulator.next()) {
    for (const Measurement& m : simulation::measurementsOf(*step)) {
      if (const auto* frame = std::get_if<StereoFrame>(&m)) {
        const FrameReport report = estimator.process(*frame);
        if (step->stale) {
          ++stale;
          stale_used += report.used > report.rejected ? 1 : 0;
        } else {
          ++fresh;
          fresh_rejected += report.frame_rejected ? 1 : 0;
        }
      } else {
        std::visit([&](const auto& sample) { estimator.process(sample); }, m);
      }
    }
    ASSERT_TRUE(isPositiveDefinite(estimator.state().pose_covariance)) << step->index;
  }
  EXPECT_GT(stale, 10u);
  EXPECT_LE(stale_used, stale / 5);
  EXPECT_LE(fresh_rejected, fresh / 50);
}

} // namespace
} // namespace vi_ekf_slam

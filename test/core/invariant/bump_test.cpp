#include <algorithm>
#include <vector>

#include "road.hpp"
#include "states.hpp"
#include "vi_ekf_slam/core/invariant/frame_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

InvariantConfig withoutManoeuvre() {
  InvariantConfig config;
  config.manoeuvre_density.setZero();
  return config;
}

/// What two filters, after 50 frames of the same drive, make of a frame before which the pitch rate rose by
/// `rise` rad/s: 0.3 are 19 sigmas of the model of motion.
struct Bump {
  FrameReport with, without;
  double error_with = 0.0, error_without = 0.0; ///< rad
};

/// `felt`: by the gyro of the second filter too.

Bump bump(unsigned seed, double rise, const InvariantConfig& with, const InvariantConfig& without,
          bool felt = true) {
  Road road(seed, 40, kTypical);
  InvariantEstimator a = makeEstimator(with), b = makeEstimator(without);
  const auto feed = [&](Bump& result, double unfelt) {
    GyroSample gyro = road.gyro();
    const VelocitySample velocity = road.velocity();
    const StereoFrame frame = road.frame();
    a.process(gyro);
    a.process(velocity);
    gyro.angular_velocity[1] -= unfelt;
    b.process(gyro);
    b.process(velocity);
    result.with = a.process(frame);
    result.without = b.process(frame);
    result.error_with = rotationError(a, road.pose());
    result.error_without = rotationError(b, road.pose());
  };
  Bump result;
  for (int i = 0; i < 50; ++i) {
    feed(result, 0.0);
    if (i < 49) road.move();
  }
  const double before = result.error_with;
  const Vector6d cruising = road.twist();
  road.setTwist(cruising + 0.5 * rise * Vector6d::Unit(4)); // the mean of the step
  road.move();
  road.setTwist(cruising + rise * Vector6d::Unit(4));
  feed(result, felt ? 0.0 : rise);
  result.error_with -= before; // what this frame added
  result.error_without -= before;
  return result;
}

TEST(FrameUpdate, SurvivesABumpThatTheModelOfMotionRulesOut) {
  int lost_without = 0;
  constexpr int kRuns = 10;
  for (unsigned seed = 0; seed < kRuns; ++seed) {
    const Bump result = bump(400 + seed, seed % 2 == 0 ? 0.3 : -0.3, {}, withoutManoeuvre());
    const std::size_t in_view = result.with.used + result.with.rejected;
    EXPECT_GT(in_view, 25u) << seed;
    EXPECT_FALSE(result.with.frame_rejected) << seed;
    EXPECT_GT(result.with.used, 0.8 * static_cast<double>(in_view)) << seed;
    EXPECT_LT(result.error_with, 0.003) << seed; // of a pitch of 0.015 rad
    lost_without += result.without.frame_rejected || 2 * result.without.used < in_view ? 1 : 0;
    EXPECT_LT(result.error_with, result.error_without) << seed;
  }
  EXPECT_EQ(lost_without, kRuns);
}

TEST(FrameUpdate, AsksTheGyroWhetherItWasABump) {
  // The whole picture moves by 20 px: believed where the gyro felt it, and not where it felt nothing.
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Bump result = bump(460 + seed, 0.56, {}, {}, false);
    EXPECT_GT(2 * result.with.used, result.with.used + result.with.rejected) << seed;
    EXPECT_LT(2 * result.without.used, result.without.used + result.without.rejected) << seed;
  }
}

TEST(FrameUpdate, LeavesAnOrdinaryFrameToTheModelOfMotion) {
  // Where the prediction agrees nothing else is tried: not a bit differs.
  Road road(420, 40, kTypical), same(420, 40, kTypical);
  InvariantEstimator with = makeEstimator(), without = makeEstimator(withoutManoeuvre());
  for (int i = 0; i < 100; ++i) {
    const FrameReport report = road.feed(with);
    same.feed(without);
    ASSERT_GE(report.used, 0.6 * static_cast<double>(report.used + report.rejected)) << i;
  }
  expectSame(with.state(), without.state(), 0.0);
}

TEST(FrameUpdate, LetsFewFeaturesNotOutvoteTheModelOfMotion) {
  Road road(421, 14, kTypical), same(421, 14, kTypical);
  InvariantEstimator with = makeEstimator(), without = makeEstimator(withoutManoeuvre());
  for (int i = 0; i < 60; ++i) {
    if (i == 50) {
      road.setTwist(road.twist() + 0.3 * Vector6d::Unit(4));
      same.setTwist(road.twist());
    }
    road.feed(with);
    same.feed(without);
  }
  expectSame(with.state(), without.state(), 0.0);
}

/// Frames in which all but a few of the points ride on a lorry ahead: the picture hardly moves.
class Lorry {
 public:
  explicit Lorry(std::size_t points, unsigned seed) : random_(seed) {
    for (std::size_t i = 0; i < points; ++i) {
      // A tail gate 8 m ahead, and some of what is seen beside it.
      points_.push_back({random_.uniform(-3.0, 3.0), random_.uniform(-1.2, 1.2), random_.uniform(8.0, 10.0)});
    }
  }

  /// Appends its features to `frame`.
  void fill(StereoFrame& frame, double pixel_sigma) {
    std::normal_distribution<double> normal(0.0, pixel_sigma);
    const StereoCamera camera = exampleRig().camera;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      StereoPixels z = camera.project(points_[i]);
      for (int k = 0; k < 4; ++k) z[k] += normal(random_.engine());
      frame.features.push_back({1000000 + i, z});
    }
  }

 private:
  Random random_;
  std::vector<Eigen::Vector3d> points_; ///< before the camera, m
};

TEST(FrameUpdate, RefusesALorryThatFillsTheView) {
  for (const Road::Noise noise : {Road::Noise{0.5, 0.05, 0.7}, Road::Noise{0.1, 0.01, 0.7}}) {
    InvariantConfig config;
    config.velocity_sigma = noise.velocity;
    config.gyro_sigma = noise.gyro;
    Road road(430, 30, noise);
    InvariantEstimator estimator = driven(road, 50, config);
    Lorry lorry(40, 1);
    double worst_velocity = 0.0;
    for (int i = 0; i < 50; ++i) {
      estimator.process(road.gyro());
      estimator.process(road.velocity());
      StereoFrame frame{road.frame().stamp, {}}; // nothing else is to be seen
      lorry.fill(frame, noise.pixel);
      const FrameReport report = estimator.process(frame);
      EXPECT_LE(report.used, 2u) << i; // straight ahead a point at rest looks the same
      worst_velocity = std::max(worst_velocity, std::abs(estimator.state().twist[0] - road.twist()[0]));
      road.move();
    }
    RecordProperty("worst_mm_per_s", static_cast<int>(1e3 * worst_velocity));
    EXPECT_LT(worst_velocity, 2.0 * noise.velocity); // the odometer's word alone
  }
}

TEST(FrameUpdate, StaysBoundedInAStreamOfNonsense) {
  // Neither pixels at random nor pictures that turn as one, at random, make the filter any less sure than it
  // is without a picture, nor any surer of its motion than the samples.
  for (const bool coherent : {false, true}) {
    Road road(440, 40, kTypical);
    InvariantConfig config;
    // What is coherent and contradicts the samples makes the motion doubtful, see recovery_test.cpp.
    if (coherent) config.divergence.window_s = 0.0;
    InvariantEstimator estimator = driven(road, 50, config);
    InvariantEstimator blind = estimator;
    Random random(5);
    for (int i = 0; i < 300; ++i) {
      const GyroSample gyro = road.gyro();
      const VelocitySample velocity = road.velocity();
      StereoFrame frame = road.frame();
      const StereoFrame nothing{frame.stamp, {}};
      const double shift = random.uniform(-60.0, 60.0), lift = random.uniform(-60.0, 60.0);
      for (auto& feature : frame.features) {
        if (coherent) {
          feature.pixels += StereoPixels(shift, lift, shift, lift);
        } else {
          const double u = random.uniform(100.0, 1200.0), v = random.uniform(0.0, 370.0);
          feature.pixels = {u, v, u - random.uniform(2.0, 90.0), v};
        }
      }
      for (InvariantEstimator* each : {&estimator, &blind}) {
        each->process(gyro);
        each->process(velocity);
      }
      estimator.process(frame);
      blind.process(nothing);
      road.move();
      const StateEstimate state = estimator.state(), bound = blind.state();
      ASSERT_TRUE(isPositiveDefinite(state.pose_covariance)) << coherent << " " << i;
      ASSERT_TRUE(isPositiveDefinite(state.twist_covariance)) << coherent << " " << i;
      ASSERT_TRUE(state.world_T_imu.matrix().allFinite());
      // Position by its trace: the two do not take the same way.
      ASSERT_LE(state.pose_covariance.topLeftCorner(3, 3).trace(),
                3.0 * bound.pose_covariance.topLeftCorner(3, 3).trace())
          << coherent << " " << i;
      for (int k = 0; k < 6; ++k) {
        ASSERT_LE(state.twist_covariance(k, k), 2.0 * bound.twist_covariance(k, k)) << coherent << " " << i;
        if (k < 3) continue;
        ASSERT_LE(state.pose_covariance(k, k), 2.0 * bound.pose_covariance(k, k)) << coherent << " " << i;
      }
    }
    EXPECT_LT(std::abs(estimator.state().twist[0] - road.twist()[0]), 1.0);
  }
}

} // namespace
} // namespace vi_ekf_slam::invariant

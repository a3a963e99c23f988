#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <variant>
#include <vector>

#include "numeric.hpp"
#include "paper_reference.hpp"
#include "vi_ekf_slam/core/so3.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using test::distance;
using test::exampleRig;
using test::Random;
using test::relativeDistance;

/// A car that drives round for ever, and sees a fixed number of points, each until it leaves the view.
class Road {
 public:
  struct Noise {
    double velocity = 0.0, gyro = 0.0, pixel = 0.0; ///< m/s, rad/s, px, standard deviations
  };

  Road(unsigned seed, std::size_t features, const Noise& noise)
      : random_(seed), noise_(noise), points_(features) {
    for (Point& point : points_) spawn(point);
  }

  /// Gyro, velocity and frame of now, 10 Hz.
  GyroSample gyro() { return {stamp_, twist_.tail<3>() + normal<3>(noise_.gyro), {}}; }
  VelocitySample velocity() { return {stamp_, twist_.head<3>() + normal<3>(noise_.velocity), {}}; }
  StereoFrame frame() {
    StereoFrame frame;
    frame.stamp = stamp_;
    for (Point& point : points_) {
      if (!project(point)) spawn(point);
      frame.features.push_back({point.id, *project(point) + normal<4>(noise_.pixel)});
    }
    return frame;
  }

  void move() {
    pose_ = (pose_ * SE3::Exp(0.1 * twist_)).normalized();
    stamp_ += 100000000;
  }

  FrameReport feed(Estimator& estimator) {
    estimator.process(gyro());
    estimator.process(velocity());
    const FrameReport report = estimator.process(frame());
    truth_ = pose_;
    move();
    return report;
  }

  const SE3& truth() const { return truth_; } ///< at the last frame fed
  const Vector6d& twist() const { return twist_; }

 private:
  struct Point {
    FeatureId id = 0;
    Eigen::Vector3d world = Eigen::Vector3d::Zero();
  };

  template <int N>
  Eigen::Matrix<double, N, 1> normal(double sigma) {
    std::normal_distribution<double> draw;
    Eigen::Matrix<double, N, 1> v;
    for (int i = 0; i < N; ++i) v[i] = sigma * draw(random_.engine());
    return v;
  }

  std::optional<StereoPixels> project(const Point& point) const {
    const Eigen::Vector3d q = rig_.cam_T_imu * pose_.inverse() * point.world;
    if (q.z() < 2.0) return std::nullopt;
    const StereoPixels z = rig_.camera.project(q);
    const bool inside = z[0] > 0.0 && z[0] < 1240.0 && z[2] > 0.0 && z[1] > 0.0 && z[1] < 370.0;
    return inside ? std::optional<StereoPixels>(z) : std::nullopt;
  }

  void spawn(Point& point) {
    point.id = next_id_++;
    const SE3 world_T_cam = pose_ * rig_.cam_T_imu.inverse();
    do {
      const double depth = random_.uniform(6.0, 40.0);
      const double u = random_.uniform(50.0, 1190.0), v = random_.uniform(20.0, 350.0);
      point.world = world_T_cam * Eigen::Vector3d((u - rig_.camera.cu) / rig_.camera.fu * depth,
                                                  (v - rig_.camera.cv) / rig_.camera.fv * depth, depth);
    } while (!project(point));
  }

  Random random_;
  Noise noise_;
  StereoRig rig_ = exampleRig();
  SE3 pose_, truth_;
  Vector6d twist_ = (Vector6d() << 8.0, 0.1, 0.0, 0.0, 0.0, 0.15).finished();
  Stamp stamp_ = fromSeconds(1000.0);
  std::vector<Point> points_;
  FeatureId next_id_ = 1;
};

const Road::Noise kQuiet{}, kTypical{0.5, 0.05, 0.7};

InvariantEstimator makeEstimator(const InvariantConfig& config = {}) {
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
  return P.allFinite() && distance(P, P.transpose()) <= 1e-9 * P.cwiseAbs().maxCoeff() &&
         P.llt().info() == Eigen::Success;
}

/// An estimator that has driven `frames` of `road`.
InvariantEstimator driven(Road& road, int frames, const InvariantConfig& config = {}) {
  InvariantEstimator estimator = makeEstimator(config);
  for (int i = 0; i < frames; ++i) road.feed(estimator);
  return estimator;
}

/// An estimator brought to the road's next frame, and that frame.
struct Ahead {
  InvariantEstimator estimator;
  StereoFrame frame;
};

Ahead ahead(Road& road, int frames, const InvariantConfig& config = {}) {
  Ahead result{driven(road, frames, config), {}};
  result.estimator.process(road.gyro());
  result.estimator.process(road.velocity());
  result.frame = road.frame();
  return result;
}

/// The state predicted to the stamp of `frame`.
StateEstimate predicted(InvariantEstimator estimator, const StereoFrame& frame) {
  estimator.process(StereoFrame{frame.stamp, {}});
  return estimator.state();
}

TEST(InvariantEstimator, FollowsAnExactDrive) {
  Road road(1, 30, kQuiet);
  InvariantEstimator estimator = makeEstimator();
  double worst = 0.0, worst_rotation = 0.0;
  for (int i = 0; i < 600; ++i) {
    const FrameReport report = road.feed(estimator);
    EXPECT_FALSE(report.frame_rejected);
    EXPECT_EQ(report.rejected, 0u);
    worst = std::max(worst, positionError(estimator, road.truth()));
    worst_rotation = std::max(worst_rotation, rotationError(estimator, road.truth()));
  }
  EXPECT_LT(worst, 1e-3);
  EXPECT_LT(worst_rotation, 1e-4);
  EXPECT_LT(distance(estimator.state().twist, road.twist()), 1e-4);
  for (const LandmarkEstimate& l : estimator.landmarks()) EXPECT_TRUE(l.position.allFinite());
}

TEST(InvariantEstimator, FollowsASimulatedDriveWithoutNoise) {
  simulation::DriveOptions options;
  options.laps = 1.0;
  options.velocity_sigma = options.gyro_sigma = options.gyro_bias_min = options.gyro_bias_max = 0.0;
  options.pixel_sigma = options.outlier_fraction = options.stale_fraction = 0.0;
  options.moving_objects = 0;
  simulation::DriveSimulator simulator(options);
  InvariantEstimator estimator({});
  estimator.setRig(simulator.rig());
  double worst = 0.0;
  std::size_t rejected = 0, frames = 0;
  while (const auto step = simulator.next()) {
    for (const Measurement& m : simulation::measurementsOf(*step)) {
      std::visit([&](const auto& sample) { estimator.process(sample); }, m);
    }
    ++frames;
    worst = std::max(worst, positionError(estimator, step->world_T_imu));
    rejected += isPositiveDefinite(estimator.state().pose_covariance) ? 0 : 1;
  }
  EXPECT_GT(frames, 300u);
  EXPECT_EQ(rejected, 0u);
  RecordProperty("worst_um", static_cast<int>(1e6 * worst));
  EXPECT_LT(
      worst,
      0.05); // m, of a lap of 460 m; not exact, and why is not known: exact pixels help less than one expects
}

/// Drives `frames` with few features; true while all covariances are sound.
void driveCheaply(int frames) {
  Road road(2, 6, kTypical);
  InvariantConfig config;
  config.map_max_landmarks = 1000;
  InvariantEstimator estimator = makeEstimator(config);
  int unsound = 0;
  std::size_t whole = 0, largest = 0;
  for (int i = 0; i < frames; ++i) {
    const FrameReport report = road.feed(estimator);
    whole += report.frame_rejected ? 1 : 0;
    largest = std::max(largest, report.landmarks);
    if (i % 100 == 0) {
      const StateEstimate state = estimator.state();
      unsound += isPositiveDefinite(state.pose_covariance) ? 0 : 1;
      unsound += isPositiveDefinite(state.twist_covariance) ? 0 : 1;
      unsound += so3::isRotation(state.world_T_imu.rotation(), 1e-12) ? 0 : 1;
    }
  }
  EXPECT_EQ(unsound, 0);
  EXPECT_LE(whole, static_cast<std::size_t>(frames) / 100);
  EXPECT_LE(largest, 6u);
  EXPECT_LE(estimator.landmarks().size(), 1006u);
}

TEST(InvariantEstimator, KeepsItsCovarianceSoundOverALongDrive) { driveCheaply(20000); }
// A minute or so; --gtest_also_run_disabled_tests.
TEST(InvariantEstimator, DISABLED_KeepsItsCovarianceSoundOverAMillionFrames) { driveCheaply(1000000); }

TEST(InvariantEstimator, GrowsLessSureOfItsYawWhileNothingReturns) {
  Road road(3, 30, kTypical);
  InvariantEstimator estimator = makeEstimator();
  std::vector<double> variance;
  for (int i = 0; i < 2000; ++i) {
    road.feed(estimator);
    variance.push_back(estimator.state().pose_covariance(5, 5));
  }
  int falls = 0;
  double worst = 0.0, late = 0.0;
  for (std::size_t i = 1; i < variance.size(); ++i) {
    const double fall = 1.0 - variance[i] / variance[i - 1];
    falls += fall > 1e-9 ? 1 : 0;
    worst = std::max(worst, fall);
    if (i > 100) late = std::max(late, fall);
  }
  RecordProperty("falls", falls);
  RecordProperty("worst_fall_ppm", static_cast<int>(1e6 * worst));
  RecordProperty("worst_late_fall_ppm", static_cast<int>(1e6 * late));
  EXPECT_LT(late, 0.05);
  // From frame to frame a fall is smoothing (a frame says better where the last ones were), over the life of
  // the tracks it would be knowledge from nowhere.
  for (std::size_t i = 100; i < variance.size(); ++i) EXPECT_GT(variance[i], variance[i - 100]);
}

TEST(InvariantEstimator, KnowsHowWrongItIs) {
  double nees = 0.0;
  constexpr int kRuns = 20;
  for (unsigned run = 0; run < kRuns; ++run) {
    Road road(100 + run, 25, kTypical);
    const InvariantEstimator estimator = driven(road, 300);
    const StateEstimate state = estimator.state();
    Vector6d error;
    error << road.truth().translation() - state.world_T_imu.translation(),
        so3::Log(road.truth().rotation() * state.world_T_imu.rotation().transpose());
    nees += error.dot(state.pose_covariance.llt().solve(error)) / (6.0 * kRuns);
  }
  EXPECT_GT(nees, 0.4);
  EXPECT_LT(nees, 2.0);
}

TEST(InvariantEstimator, RejectsAnImpossibleFrameAsAWhole) {
  // Every point where it would be had the car jumped: they agree with each other, and not with the car.
  for (const double jump : {2.5, 4.0}) {
    Road road(4, 30, {0.1, 0.01, 0.7});
    InvariantConfig config;
    config.velocity_sigma = 0.1;
    config.gyro_sigma = 0.01;
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
    InvariantConfig config;
    config.consensus = consensus;
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
      {1e9, 100.0, 5e8, 100.0},    {100.0, 100.0, 100.0, 100.0},  {100.0, 100.0, 120.0, 100.0},
      {100.0, 100.0, 60.0, 105.0}, {1e300, 1e300, -1e300, 1e300}, {100.0, -1e7, 60.0, -1e7}};
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

TEST(InvariantEstimator, TakesNoFeaturesBeforeItsRig) {
  InvariantEstimator estimator({});
  Road road(7, 20, kTypical);
  for (int i = 0; i < 5; ++i) {
    const FrameReport report = road.feed(estimator);
    EXPECT_EQ(report.features, 20u);
    EXPECT_EQ(report.invalid, 20u);
    EXPECT_EQ(report.landmarks, 0u);
    EXPECT_TRUE(estimator.landmarks().empty());
  }
  estimator.setRig(exampleRig());
  EXPECT_GT(road.feed(estimator).initialised, 15u);
}

TEST(InvariantEstimator, StartsAtTheIdentityWithTheFirstStamp) {
  InvariantEstimator estimator({});
  EXPECT_EQ(estimator.state().stamp, 0);
  estimator.process(GyroSample{fromSeconds(5.0), {0.0, 0.0, 0.1}, {}});
  EXPECT_EQ(estimator.state().stamp, fromSeconds(5.0));
  EXPECT_LT(distance(estimator.state().world_T_imu.matrix(), Eigen::Matrix4d::Identity()), 1e-9);
  EXPECT_TRUE(isPositiveDefinite(estimator.state().pose_covariance));
}

TEST(InvariantEstimator, TakesTheCovarianceOfTheSample) {
  const InvariantConfig config;
  for (const double sigma : {0.01, 0.5}) {
    const Eigen::Matrix3d R = sigma * sigma * Eigen::Matrix3d::Identity();
    InvariantEstimator estimator(config);
    estimator.process(GyroSample{1, {0.1, 0.2, 0.3}, R});
    estimator.process(VelocitySample{1, {5.0, 0.2, 0.3}, R});
    const StateEstimate state = estimator.state();
    for (int i = 0; i < 6; ++i) {
      const double P = std::pow(config.prior_twist_sigma[i], 2), B = std::pow(config.prior_bias_sigma[i], 2);
      EXPECT_NEAR(state.twist_covariance(i, i), P - P * P / (P + B + sigma * sigma), 1e-12);
    }
    EXPECT_NEAR(state.twist[0], 5.0 * 225.0 / (225.0 + 1e-6 + sigma * sigma), 1e-9);
  }
  // Without one the configured noise holds.
  InvariantEstimator silent(config), told(config);
  silent.process(GyroSample{1, {0.1, 0.2, 0.3}, {}});
  told.process(GyroSample{1, {0.1, 0.2, 0.3}, Eigen::Matrix3d(0.0025 * Eigen::Matrix3d::Identity())});
  expectSame(silent.state(), told.state(), 1e-15);
}

TEST(InvariantEstimator, DoesNotCareAboutTheOrderOfEqualStamps) {
  Road road(8, 25, kTypical);
  const Ahead start = ahead(road, 50);
  InvariantEstimator one = start.estimator, other = start.estimator;
  road.move();
  const GyroSample gyro = road.gyro();
  const VelocitySample velocity = road.velocity();
  one.process(gyro);
  one.process(velocity);
  other.process(velocity);
  other.process(gyro);
  // Same to first order: the pose's correction is not linear.
  EXPECT_LT(relativeDistance(one.state().pose_covariance, other.state().pose_covariance), 1e-3);
  EXPECT_LT(relativeDistance(one.state().twist_covariance, other.state().twist_covariance), 1e-9);
  EXPECT_LT(distance(one.state().twist, other.state().twist), 1e-9);
  EXPECT_LT(distance(one.state().world_T_imu.matrix(), other.state().world_T_imu.matrix()), 1e-3);
}

TEST(InvariantEstimator, BoundsTheMap) {
  InvariantConfig config;
  config.map_max_landmarks = 40;
  Road road(9, 20, kTypical);
  InvariantEstimator estimator = makeEstimator(config);
  for (int i = 0; i < 300; ++i) {
    const FrameReport report = road.feed(estimator);
    const auto map = estimator.landmarks();
    EXPECT_LE(map.size(), 40 + report.landmarks);
    EXPECT_TRUE(
        std::is_sorted(map.begin(), map.end(),
                       [](const LandmarkEstimate& a, const LandmarkEstimate& b) { return a.id < b.id; }));
    EXPECT_EQ(
        std::adjacent_find(map.begin(), map.end(),
                           [](const LandmarkEstimate& a, const LandmarkEstimate& b) { return a.id == b.id; }),
        map.end());
  }
  EXPECT_GT(estimator.landmarks().size(), 40u);
}

TEST(InvariantEstimator, KeepsOnlyWhatItSawOften) {
  for (const std::size_t least : {1, 3, 5}) {
    InvariantConfig config;
    config.map_min_observations = least;
    Road road(10, 30, kQuiet);
    InvariantEstimator estimator = makeEstimator(config);
    std::map<FeatureId, std::size_t> seen;
    std::set<FeatureId> last;
    for (int i = 0; i < 100; ++i) {
      estimator.process(road.gyro());
      estimator.process(road.velocity());
      const StereoFrame frame = road.frame();
      estimator.process(frame);
      last.clear();
      for (const auto& feature : frame.features) {
        ++seen[feature.id];
        last.insert(feature.id);
      }
      road.move();
    }
    std::set<FeatureId> map;
    for (const LandmarkEstimate& l : estimator.landmarks()) map.insert(l.id);
    int wrong = 0;
    for (const auto& [id, count] : seen) {
      wrong += (map.count(id) == 1) != (last.count(id) == 1 || count >= least) ? 1 : 0;
    }
    EXPECT_EQ(wrong, 0) << least;
  }
}

TEST(InvariantEstimator, SurvivesIdsThatChangeHands) {
  Road road(11, 30, {0.1, 0.01, 0.3});
  InvariantConfig config;
  config.velocity_sigma = 0.1;
  config.gyro_sigma = 0.01;
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
  EXPECT_GE(at.initialised, 25u);
  std::size_t used = 0;
  for (int i = 0; i < 3; ++i) {
    road.move();
    const GyroSample gyro = road.gyro();
    const VelocitySample velocity = road.velocity();
    const StereoFrame frame = road.frame();
    for (InvariantEstimator* estimator : {&now.estimator, &other}) {
      estimator->process(gyro);
      estimator->process(velocity);
    }
    other.process(frame);
    used = now.estimator.process(swapped(frame)).used;
  }
  EXPECT_GE(used, 15u);
  EXPECT_LT(
      distance(now.estimator.state().world_T_imu.translation(), other.state().world_T_imu.translation()),
      0.1);
}

TEST(InvariantEstimator, SurvivesStaleFrames) {
  simulation::DriveOptions options;
  options.duration = 60.0;
  simulation::DriveSimulator simulator(options);
  InvariantEstimator estimator({});
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

TEST(InvariantEstimator, RepeatsItself) {
  Road first(12, 30, kTypical), second(12, 30, kTypical);
  const InvariantEstimator a = driven(first, 200), b = driven(second, 200);
  expectSame(a.state(), b.state(), 0.0);
  const auto map_a = a.landmarks(), map_b = b.landmarks();
  ASSERT_EQ(map_a.size(), map_b.size());
  for (std::size_t i = 0; i < map_a.size(); ++i) {
    EXPECT_EQ(map_a[i].id, map_b[i].id);
    EXPECT_EQ(distance(map_a[i].position, map_b[i].position), 0.0);
    EXPECT_EQ(distance(map_a[i].covariance, map_b[i].covariance), 0.0);
  }
}

TEST(InvariantEstimator, StaysSoundThroughAGap) {
  Road road(13, 25, kTypical);
  InvariantEstimator estimator = driven(road, 50);
  for (int i = 0; i < 100; ++i) road.move(); // 10 s without anything
  for (int i = 0; i < 50; ++i) {
    road.feed(estimator);
    ASSERT_TRUE(isPositiveDefinite(estimator.state().pose_covariance)) << i;
    ASSERT_TRUE(isPositiveDefinite(estimator.state().twist_covariance)) << i;
  }
  EXPECT_LT(distance(estimator.state().twist, road.twist()), 0.5);
}

} // namespace
} // namespace vi_ekf_slam::invariant

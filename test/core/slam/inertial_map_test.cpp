// Poses that are told and maps that are found again, where gravity knows what is up.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../flight.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam::test {
namespace {

FlightOptions mapFlight() {
  FlightOptions options;
  options.imu_rate = 100.0;
  options.pixel = 0.3;
  options.points = 200;
  options.gyro_bias = {0.01, -0.02, 0.015};
  return options;
}

/// A flight of 10 s with an estimate that has started by itself.
struct Flown {
  explicit Flown(unsigned seed)
      : flight(seed, mapFlight()),
        estimator(inertialEstimator(inertialConfig(mapFlight(), mapFlight().pixel))) {
    while (!estimator.hasStarted() && flight.seconds() < 5.0) flight.feed(estimator);
    EXPECT_TRUE(estimator.hasStarted()) << estimator.startProblem();
    const SE3 truth = flight.pose(flight.lastSeconds());
    map_T_world = levelled(estimator.state().world_T_imu, truth) * truth.inverse();
    while (flight.seconds() < 10.0) flight.feed(estimator);
  }
  /// Where it is in the map.
  SE3 truth() const { return map_T_world * flight.pose(flight.lastSeconds()); }

  Flight flight;
  InertialEstimator estimator;
  SE3 map_T_world;
};

double tiltBetween(const SE3& a, const SE3& b) {
  const Eigen::Vector3d up_a = a.rotation().transpose().col(2), up_b = b.rotation().transpose().col(2);
  return std::asin(std::min(1.0, up_a.cross(up_b).norm()));
}

void expectNear(const SE3& got, const SE3& expected, double m, double rad) {
  EXPECT_LT((got.translation() - expected.translation()).norm(), m);
  EXPECT_LT(so3::Log(got.rotation().transpose() * expected.rotation()).norm(), rad);
}

TEST(InertialToldPose, IsWhereItGoesOnWithTheTiltThatGravityKnows) {
  Flown flown(1);
  const StateEstimate before = flown.estimator.state();
  const Matrix6d known = (Vector6d() << 0.04, 0.04, 0.01, 1e-3, 1e-3, 4e-3).finished().asDiagonal();
  // Somebody in front of a screen says it, who has no idea of the tilt.
  const SE3 told(so3::Exp({0.0, 0.0, 2.0}), {20.0, -5.0, 1.0});
  ASSERT_TRUE(flown.estimator.setPose(told, known));
  const StateEstimate after = flown.estimator.state();
  EXPECT_LT((after.world_T_imu.translation() - told.translation()).norm(), 1e-9);
  EXPECT_LT(tiltBetween(after.world_T_imu, before.world_T_imu), 1e-9);
  EXPECT_LT(std::abs(so3::heading(after.world_T_imu.rotation() * told.rotation().transpose())), 0.1);
  EXPECT_LT(distance(after.twist, before.twist), 1e-9) << "along the body's axes nothing has changed";
  EXPECT_LT(relativeDistance(after.pose_covariance.topLeftCorner<3, 3>(), known.topLeftCorner<3, 3>()), 1e-2);
  EXPECT_NEAR(after.pose_covariance(5, 5), 4e-3, 1e-4);
  const Eigen::Vector2d tilt = after.pose_covariance.diagonal().segment<2>(3);
  EXPECT_NEAR(tilt.sum(), before.pose_covariance.diagonal().segment<2>(3).sum(), 1e-3 * tilt.sum())
      << "what was known of the tilt is";
  const SE3 moved = after.world_T_imu * before.world_T_imu.inverse();
  // There are other landmarks there.
  const auto others = [](auto& measurement) {
    if constexpr (std::is_same_v<std::decay_t<decltype(measurement)>, StereoFrame>) {
      for (StereoFeatureObservation& feature : measurement.features) feature.id += 1000;
    }
  };
  for (int i = 0; i < 50; ++i) flown.flight.feed(flown.estimator, others);
  expectNear(flown.estimator.state().world_T_imu, moved * flown.truth(), 0.15, 0.03);
}

TEST(InertialToldPose, BeforeTheStartIsRefused) {
  InertialEstimator estimator = inertialEstimator(inertialConfig(mapFlight()));
  EXPECT_FALSE(estimator.setPose(SE3(), 0.01 * Matrix6d::Identity()));
}

TEST(InertialMap, IsResumedFromWithoutAStartOfItsOwn) {
  Flown flown(2);
  const auto map = std::make_shared<const SavedMap>(flown.estimator.savedMap()());
  InertialEstimator second = inertialEstimator(inertialConfig(mapFlight(), mapFlight().pixel));
  second.resumeFrom(map, "map.bag", 5.0);
  EXPECT_FALSE(second.hasStarted());
  EXPECT_EQ(second.mapUse(), MapUse::kWaiting);
  flown.flight.skip(0.2);
  flown.flight.feedSample(second, [](auto&) {});
  ASSERT_TRUE(second.hasStarted());
  EXPECT_EQ(second.mapUse(), MapUse::kResumed);
  EXPECT_EQ(savedVariable(second.savedMap()(), Inertial::kGyroBias),
            savedVariable(*map, Inertial::kGyroBias));
  for (int i = 0; i < 50; ++i) ASSERT_EQ(flown.flight.feed(second).divergence, Divergence::kNone);
  expectNear(second.state().world_T_imu, flown.truth(), 0.15, 0.03);
}

TEST(InertialMap, IsResumedFromBeforeTheCalibrationIsKnown) {
  Flown flown(2);
  const auto map = std::make_shared<const SavedMap>(flown.estimator.savedMap()());
  InertialEstimator second(inertialConfig(mapFlight(), mapFlight().pixel));
  second.resumeFrom(map, "map.bag", 5.0);
  second.setRig(exampleRig());
  flown.flight.skip(0.2);
  std::size_t used = 0;
  for (int i = 0; i < 50; ++i) used += flown.flight.feed(second).used;
  EXPECT_EQ(second.mapUse(), MapUse::kResumed);
  EXPECT_GT(used, 500u);
  expectNear(second.state().world_T_imu, flown.truth(), 0.15, 0.03);
}

// Whose configuration leaves the motion open: it is that of the map.
TEST(InertialMap, IsResumedFromByASystemThatIsToFindItsMotion) {
  Flown flown(2);
  const auto map = std::make_shared<const SavedMap>(flown.estimator.savedMap()());
  Config config;
  config.invariant = inertialConfig(mapFlight(), mapFlight().pixel);
  config.invariant.choice = MotionChoice::kAuto;
  SlamSystem system(config);
  system.resumeFrom(map, "map.bag");
  EXPECT_EQ(system.motion(), MotionChoice::kInertial);
  system.setRig(exampleRig());
  flown.flight.skip(0.2);
  for (int i = 0; i < 20; ++i) system.add(flown.flight.sample());
  system.flush();
  EXPECT_EQ(system.estimator().mapUse(), MapUse::kResumed);
}

// Too long after it was saved it is a map to find one's place in.
TEST(InertialMap, OfLongAgoIsNotResumedFromButFoundAgain) {
  Flown flown(2);
  const auto map = std::make_shared<const SavedMap>(flown.estimator.savedMap()());
  InertialEstimator second = inertialEstimator(inertialConfig(mapFlight(), mapFlight().pixel));
  second.resumeFrom(map, "map.bag", 5.0);
  flown.flight.skip(20.0);
  flown.flight.feedSample(second, [](auto&) {});
  EXPECT_FALSE(second.hasStarted());
  EXPECT_EQ(second.mapUse(), MapUse::kWaiting);
  for (int i = 0; i < 150 && second.mapUse() != MapUse::kRelocalised; ++i) flown.flight.feed(second);
  EXPECT_EQ(second.mapUse(), MapUse::kRelocalised);
  expectNear(second.state().world_T_imu, flown.truth(), 0.15, 0.03);
}

// Before the first sample it may have turned anyhow.
TEST(InertialMap, OfASecondAgoIsNotResumedFrom) {
  Flown flown(2);
  InertialEstimator second = inertialEstimator(inertialConfig(mapFlight(), mapFlight().pixel));
  second.resumeFrom(std::make_shared<const SavedMap>(flown.estimator.savedMap()()), "map.bag", 5.0);
  flown.flight.skip(1.0);
  flown.flight.feedSample(second, [](auto&) {});
  EXPECT_FALSE(second.hasStarted());
  EXPECT_EQ(second.mapUse(), MapUse::kWaiting);
}

/// A flight through a gap in which nothing is measured: 8 s before it, and 8 s after it.
struct Gap {
  Gap(unsigned seed, double gap, double jump, FeatureId renumbered) : flight(seed, mapFlight()) {
    Config config;
    config.invariant = inertialConfig(mapFlight(), mapFlight().pixel);
    config.buffer.max_jump_s = jump;
    system = std::make_unique<SlamSystem>(config);
    system->onReset([this](const std::string& reason, const PathEstimate&) { reasons.push_back(reason); });
    system->onFrame([this](const Output& output) { note(output.state); });
    system->setRig(exampleRig());
    fly(8.0, 0);
    flight.skip(gap);
    fly(8.0, renumbered);
    system->flush();
  }

  void fly(double seconds, FeatureId renumbered) {
    for (const double end = flight.seconds() + seconds; flight.seconds() < end;) {
      for (int i = 0; i < 10; ++i) system->add(flight.sample());
      StereoFrame frame = flight.frame();
      for (auto& feature : frame.features) feature.id += renumbered;
      system->add(frame);
    }
  }
  void note(const StateEstimate& state) {
    if (system->counts().resets > 0) {
      if (!first_after) first_after = state;
      return;
    }
    const SE3 truth = flight.pose(flight.timeOf(state.stamp));
    map_T_world = levelled(state.world_T_imu, truth) * truth.inverse();
  }
  SE3 truth(const StateEstimate& state) { return map_T_world * flight.pose(flight.timeOf(state.stamp)); }

  Flight flight;
  std::unique_ptr<SlamSystem> system;
  std::vector<std::string> reasons;
  SE3 map_T_world; ///< as it was known at the gap
  std::optional<StateEstimate> first_after;
};

// Whatever counts as a jump of the clock.
TEST(InertialMap, OfBeforeAGapIsWhereItFindsItsPlaceAgain) {
  for (const double jump : {1.0, 60.0}) {
    for (const double gap : {0.5, 2.0}) {
      Gap flown(2, gap, jump, 0);
      const bool is_bridged = gap < 0.75;
      EXPECT_EQ(flown.system->counts().resets, is_bridged ? 0u : 1u) << gap;
      ASSERT_EQ(flown.reasons.size(), is_bridged ? 0u : 1u);
      if (!is_bridged) {
        EXPECT_NE(flown.reasons[0].find("orientation is not known"), std::string::npos) << flown.reasons[0];
        EXPECT_EQ(flown.system->estimator().mapUse(), MapUse::kRelocalised);
      }
      const StateEstimate state = flown.system->estimator().state();
      expectNear(state.world_T_imu, flown.truth(state), 0.15, 0.03);
    }
  }
}

// Nothing is recognised: it is near where it was, and knows how near.
TEST(InertialMap, OfBeforeAGapIsTheFrameInWhichItBeginsAnew) {
  for (unsigned seed = 2; seed < 7; ++seed) {
    Gap flown(seed, 1.2, seed % 2 == 0 ? 1.0 : 60.0, 1000000);
    ASSERT_EQ(flown.reasons.size(), 1u) << seed;
    ASSERT_TRUE(flown.first_after) << seed;
    for (const StateEstimate& state : {*flown.first_after, flown.system->estimator().state()}) {
      const SE3 truth = flown.truth(state);
      Vector6d error;
      error << truth.translation() - state.world_T_imu.translation(),
          so3::Log(truth.rotation() * state.world_T_imu.rotation().transpose());
      EXPECT_LT(error.head<3>().norm(), 5.0) << seed;
      EXPECT_LT(std::abs(error[5]), 1.0) << seed;
      EXPECT_LT(squaredMahalanobis(error, state.pose_covariance), 16.8) << seed << ": 99 %";
    }
    EXPECT_EQ(flown.system->estimator().mapUse(), MapUse::kWaiting);
    flown.system->reset("somebody asks for it");
    EXPECT_EQ(flown.system->estimator().mapUse(), MapUse::kNone) << "nothing is left of before";
  }
}

TEST(InertialMap, IsFoundAgainFromAStartThatHeadsElsewhere) {
  for (unsigned seed = 3; seed < 6; ++seed) {
    Flown flown(seed);
    const auto map = std::make_shared<const SavedMap>(flown.estimator.savedMap()());
    ASSERT_GE(map->landmarks.size(), 10u);
    InertialEstimator second = inertialEstimator(inertialConfig(mapFlight(), mapFlight().pixel));
    second.relocaliseIn(map);
    EXPECT_EQ(second.mapUse(), MapUse::kWaiting);
    flown.flight.skip(2.0);
    SE3 own; // the last one in a frame of its own
    double turn = 0.0;
    for (int i = 0; i < 150 && second.mapUse() != MapUse::kRelocalised; ++i) {
      flown.flight.feed(second);
      if (second.hasStarted() && second.mapUse() == MapUse::kWaiting) {
        own = second.state().world_T_imu;
        turn = so3::heading(flown.truth().rotation() * own.rotation().transpose());
      }
    }
    ASSERT_EQ(second.mapUse(), MapUse::kRelocalised) << seed;
    EXPECT_GT(std::abs(turn), 0.05) << seed << ": the two maps head the same way";
    expectNear(second.state().world_T_imu, flown.truth(), 0.15, 0.03);
    EXPECT_LT(tiltBetween(second.state().world_T_imu, flown.truth()), 0.02);
    for (int i = 0; i < 30; ++i) ASSERT_EQ(flown.flight.feed(second).divergence, Divergence::kNone);
    expectNear(second.state().world_T_imu, flown.truth(), 0.15, 0.03);
  }
}

} // namespace
} // namespace vi_ekf_slam::test

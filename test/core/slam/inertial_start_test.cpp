// How an inertial estimate starts by itself, at rest and in motion, and where it refuses to.

#include "../flight.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"
#include "vi_ekf_slam/core/slam/inertial_alignment.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam::test {
namespace {

/// The vertical along the body's axes.
Eigen::Vector3d upOf(const Eigen::Matrix3d& R) { return R.transpose().col(2); }

/// What is true, and known about as well as a start by itself knows it.
InitialState rightState(const Flight& flight) {
  Eigen::Matrix<double, 15, 1> sigma;
  sigma << 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 5e-3, 5e-3, 5e-3, 0.05, 0.05, 0.05;
  return flight.initialState(sigma, Eigen::Matrix<double, 15, 1>::Zero());
}

class InertialStart : public ::testing::TestWithParam<bool> {};

TEST_P(InertialStart, IsAtTheOriginOfAMapThatPointsUpWithinThreeSeconds) {
  for (unsigned seed = 0; seed < 8; ++seed) {
    const FlightOptions options = startFlight(GetParam());
    Flight flight(seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    EXPECT_FALSE(estimator.hasStarted());
    EXPECT_FALSE(estimator.startProblem().empty());
    EXPECT_TRUE(estimator.landmarks().empty());
    startOf(flight, estimator);
    ASSERT_TRUE(estimator.hasStarted()) << seed << ": " << estimator.startProblem();
    EXPECT_TRUE(estimator.startProblem().empty());
    EXPECT_LE(flight.seconds(), 3.0 + 1e-6) << seed;
    const double t = flight.lastSeconds();
    const SE3 truth = flight.pose(t);
    const StateEstimate state = estimator.state();
    EXPECT_EQ(state.stamp, flight.stamp() - fromSeconds(1.0 / options.imu_rate));
    EXPECT_LT(state.world_T_imu.translation().norm(), 1e-12);
    EXPECT_NEAR(so3::heading(state.world_T_imu.rotation()), 0.0, 1e-12);
    const double tilt = std::acos(upOf(state.world_T_imu.rotation()).dot(upOf(truth.rotation())));
    const Eigen::VectorXd sigma = state.pose_covariance.diagonal().cwiseSqrt();
    EXPECT_LT(tilt, 4.0 * sigma.segment<2>(3).norm()) << seed;
    EXPECT_LT(tilt, 0.05) << seed;
    for (const Eigen::Index known : {0, 1, 2, 5}) EXPECT_LT(sigma[known], 1e-5);
    const Eigen::Vector3d v = truth.rotation().transpose() * flight.velocity(t);
    EXPECT_LT((state.twist.head<3>() - v).norm(),
              4.0 * std::sqrt(state.twist_covariance.topLeftCorner<3, 3>().trace()))
        << seed;
    // And it goes on well.
    const SE3 map_T_world = levelled(state.world_T_imu, truth) * truth.inverse();
    while (flight.seconds() < 8.0) ASSERT_EQ(flight.feed(estimator).divergence, Divergence::kNone);
    const SE3 expected = map_T_world * flight.pose(flight.lastSeconds());
    const double position_sigma = std::sqrt(estimator.state().pose_covariance.topLeftCorner<3, 3>().trace());
    EXPECT_LT((estimator.state().world_T_imu.translation() - expected.translation()).norm(),
              std::min(4.0 * position_sigma, 0.2))
        << seed;
    EXPECT_LT(so3::Log(estimator.state().world_T_imu.rotation().transpose() * expected.rotation()).norm(),
              0.02)
        << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(AtRest, InertialStart, ::testing::Bool());

/// All that it says in 5 s in which `change` is made of what is measured; it must not start.
template <typename Change>
std::string problemsWith(bool at_rest, unsigned seed, const Change& change) {
  const FlightOptions options = startFlight(at_rest);
  Flight flight(seed, options);
  InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
  std::string all;
  while (!estimator.hasStarted() && flight.seconds() < 5.0) {
    flight.feed(estimator, change);
    all += estimator.startProblem() + "\n";
  }
  EXPECT_FALSE(estimator.hasStarted()) << "seed " << seed;
  return all;
}

TEST(InertialStart, RefusesAccelerationsInUnitsOfGravityAndSaysSo) {
  for (const bool at_rest : {false, true}) {
    for (unsigned seed = 0; seed < 3; ++seed) {
      const std::string problem = problemsWith(at_rest, seed, ofAccelerations([](const Eigen::Vector3d& a) {
                                                 return Eigen::Vector3d(a / kGravity);
                                               }));
      EXPECT_NE(problem.find("are the accelerations in g"), std::string::npos) << problem;
    }
  }
}

// Some drivers take gravity away: at rest that is nothing at all.
TEST(InertialStart, RefusesAccelerationsWithoutGravityAndSaysSo) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    const std::string problem = problemsWith(true, seed, ofAccelerations([](const Eigen::Vector3d& a) {
                                               return Eigen::Vector3d(a - kGravity * a.normalized());
                                             }));
    EXPECT_NE(problem.find("gravity is not explained"), std::string::npos) << problem;
    EXPECT_NE(problem.find("is gravity taken out of them?"), std::string::npos) << problem;
    EXPECT_NE(problem.find("9.81"), std::string::npos) << problem;
  }
}

bool blamesAxes(const std::string& text) {
  return text.find("are the IMU's axes those of the transform") != std::string::npos;
}

// At rest nothing tells; in motion the pictures do.
TEST(InertialStart, RefusesAnImuWhoseAxesAreOthersAndSaysSo) {
  for (unsigned seed = 0; seed < 8; ++seed) {
    const std::string problem = problemsWith(false, seed, ofAccelerations([](const Eigen::Vector3d& a) {
                                               return Eigen::Vector3d(a.x(), a.z(), -a.y());
                                             }));
    EXPECT_TRUE(blamesAxes(problem)) << problem;
  }
}

Eigen::Vector3d asItIs(const Eigen::Vector3d& a) { return a; }
/// Turned by 90 and 180 deg about the vertical, by which gravity tells nothing.
Eigen::Vector3d quarterTurned(const Eigen::Vector3d& a) { return {a.y(), -a.x(), a.z()}; }
Eigen::Vector3d halfTurned(const Eigen::Vector3d& a) { return {-a.x(), -a.y(), a.z()}; }

/// What contradicts the estimate in 12 s after it has started; nothing also where it does not start.
template <typename Change>
std::string contradictionOf(Flight& flight, InertialEstimator& estimator, const Change& change) {
  startOf(flight, estimator, change);
  const double end = flight.seconds() + 12.0;
  while (estimator.hasStarted() && estimator.contradiction().empty() && flight.seconds() < end)
    flight.feed(estimator, change);
  return estimator.contradiction();
}

// Little motion is explained by wrong axes too; what comes of it is not.
TEST(InertialStart, ThatPassedForRightIsFoundOutAndSaysWhy) {
  const FlightOptions options = startFlight(false);
  int started = 0;
  for (const auto turned : {quarterTurned, halfTurned}) {
    for (unsigned seed = 0; seed < 20; ++seed) {
      Flight flight(seed, options);
      InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
      const std::string contradiction = contradictionOf(flight, estimator, ofAccelerations(turned));
      if (!estimator.hasStarted()) continue;
      ++started;
      EXPECT_TRUE(blamesAxes(contradiction)) << "seed " << seed << ": " << contradiction;
    }
  }
  EXPECT_GT(started, 0);
  EXPECT_LT(started, 40) << "none is refused";
}

// As a body does that started at rest, where any axes are right.
TEST(InertialStart, WrongAxesAreFoundOutFromAGivenStateToo) {
  const FlightOptions options = startFlight(false);
  for (const auto change : {asItIs, quarterTurned}) {
    Flight flight(6, options);
    flight.sample();
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    ASSERT_TRUE(estimator.begin(rightState(flight)));
    const std::string contradiction = contradictionOf(flight, estimator, ofAccelerations(change));
    EXPECT_EQ(blamesAxes(contradiction), change == quarterTurned) << contradiction;
  }
}

// Before it diverges again it may be the bias that no accelerometer has.
TEST(InertialStart, WrongAxesAreFoundOutByTheBiasThatTheyNeed) {
  const FlightOptions options = startFlight(false);
  Flight flight(6, options);
  flight.sample();
  InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
  ASSERT_TRUE(estimator.begin(rightState(flight)));
  int divergences = 0;
  while (estimator.contradiction().empty() && flight.seconds() < 15.0) {
    if (flight.feed(estimator, ofAccelerations(quarterTurned)).divergence != Divergence::kNone) ++divergences;
  }
  EXPECT_TRUE(blamesAxes(estimator.contradiction())) << estimator.contradiction();
  EXPECT_LT(divergences, 2); // which would have been enough by themselves
}

// Of a right IMU, as with a quaternion given the wrong way round. The filter does not find back from there.
TEST(InertialStart, AGivenTiltThatIsNoneIsFoundOut) {
  for (const double motion : {0.1, 1.0}) {
    for (const double tilt : {0.1, 1.0, 3.0}) {
      FlightOptions options = startFlight(false);
      options.motion = motion;
      Flight flight(4, options);
      flight.sample();
      InitialState state = rightState(flight);
      state.world_T_imu =
          SE3(so3::Exp({tilt, 0.0, 0.0}) * state.world_T_imu.rotation(), state.world_T_imu.translation());
      InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
      ASSERT_TRUE(estimator.begin(state));
      while (estimator.contradiction().empty() && flight.seconds() < 12.0) flight.feed(estimator);
      const bool is_blamed = estimator.contradiction().find("map's vertical") != std::string::npos;
      EXPECT_EQ(is_blamed, tilt >= 1.0) << motion << ", " << tilt << ": " << estimator.contradiction();
      EXPECT_LT(flight.seconds(), tilt >= 1.0 ? 6.0 : 13.0);
    }
  }
}

TEST(InertialStart, TheSystemBeginsAnewWhereTheAxesAreFoundOut) {
  const FlightOptions options = startFlight(false);
  std::uint64_t resets = 0;
  for (unsigned seed = 0; seed < 8; ++seed) {
    Config config;
    config.estimator = EstimatorType::kInvariant;
    config.invariant = inertialConfig(options, options.pixel);
    SlamSystem system(config);
    std::vector<std::string> told;
    system.onReset([&](const std::string& reason, const PathEstimate&) {
      told.push_back(reason);
      EXPECT_TRUE(blamesAxes(reason)) << reason;
      EXPECT_FALSE(system.estimator().hasStarted());
    });
    system.setRig(exampleRig());
    Flight flight(seed, options);
    while (flight.seconds() < 12.0) {
      for (int i = 0; i < 20; ++i) {
        ImuSample sample = flight.sample();
        *sample.acceleration = quarterTurned(*sample.acceleration);
        system.add(sample);
      }
      system.add(flight.frame());
    }
    system.flush();
    EXPECT_EQ(system.counts().resets, told.size());
    EXPECT_GT(system.counts().frames_before_start, 20U);
    resets += system.counts().resets;
  }
  EXPECT_GT(resets, 0U);
}

// What diverges of bad pictures has nothing to do with the IMU.
TEST(InertialStart, IsNotBlamedForPicturesThatAreWrong) {
  const FlightOptions options = startFlight(false);
  for (unsigned seed = 0; seed < 6; ++seed) {
    Flight flight(seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    startOf(flight, estimator);
    ASSERT_TRUE(estimator.hasStarted()) << estimator.startProblem();
    int divergences = 0;
    while (flight.seconds() < 20.0) {
      // A picture of elsewhere, again and again.
      const bool is_wrong = flight.seconds() > 4.0 && flight.seconds() < 8.0;
      const FrameReport report = flight.feed(estimator, ofFeatures([&](StereoFeatureObservation& f) {
                                               if (is_wrong)
                                                 f.pixels += StereoPixels(40.0, 15.0, 40.0, 15.0) *
                                                             flight.random().gaussian<1>(1.0)[0];
                                             }));
      if (report.divergence != Divergence::kNone) ++divergences;
      ASSERT_EQ(estimator.contradiction(), "") << "seed " << seed << " at " << flight.seconds();
    }
    EXPECT_GT(divergences, 0);
  }
}

TEST(InertialStart, IsNotKeptByFeaturesThatAreNoisierThanTheySay) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    FlightOptions options = startFlight(false);
    options.pixel = 1.0;
    Flight flight(seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel / 1.4));
    startOf(flight, estimator);
    EXPECT_TRUE(estimator.hasStarted()) << seed << ": " << estimator.startProblem();
  }
}

TEST(InertialStart, IsNotKeptByOneMatchInSixThatIsWrong) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    const FlightOptions options = startFlight(false);
    Flight flight(seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    const StereoPixels elsewhere(400.0, 200.0, 390.0, 200.0);
    startOf(flight, estimator, ofFeatures([&](StereoFeatureObservation& f) {
              if (flight.random().uniform(0.0, 6.0) < 1.0) f.pixels = elsewhere;
            }));
    ASSERT_TRUE(estimator.hasStarted()) << seed << ": " << estimator.startProblem();
    const Eigen::Matrix3d truth = flight.pose(flight.lastSeconds()).rotation();
    EXPECT_LT(std::acos(upOf(estimator.state().world_T_imu.rotation()).dot(upOf(truth))), 0.05) << seed;
  }
}

TEST(InertialStart, SaysWhatItWaitsFor) {
  const FlightOptions options = startFlight(false);
  Flight flight(1, options);
  InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
  EXPECT_EQ(estimator.startProblem(), "waits for frames");
  const auto blind = [](auto& measurement) {
    if constexpr (std::is_same_v<std::decay_t<decltype(measurement)>, StereoFrame>)
      measurement.features.clear();
  };
  for (int i = 0; i < 20; ++i) flight.feed(estimator, blind);
  EXPECT_EQ(estimator.startProblem(),
            "waits for frames with features: 8 that are followed in each, over 1 s");
  // It starts as soon as there are.
  const double then = flight.seconds();
  startOf(flight, estimator);
  EXPECT_TRUE(estimator.hasStarted());
  EXPECT_LE(flight.seconds() - then, 2.0 + 1e-6);
  // Frames alone are not enough.
  InertialEstimator other = inertialEstimator(inertialConfig(options, options.pixel));
  Flight silent(2, options);
  for (int i = 0; i < 15; ++i) {
    for (int k = 0; k < 20; ++k) silent.sample();
    other.process(silent.frame());
  }
  EXPECT_FALSE(other.hasStarted());
  EXPECT_EQ(other.startProblem(), "waits for the IMU");
}

TEST(InertialStart, GoesOnFromAGivenState) {
  const FlightOptions options = startFlight(false);
  Flight flight(3, options);
  InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
  for (int i = 0; i < 3; ++i) flight.sample();
  const InitialState state = rightState(flight);
  EXPECT_TRUE(estimator.begin(state));
  EXPECT_FALSE(estimator.hasStarted());
  flight.feedSample(estimator, [](auto&) {});
  ASSERT_TRUE(estimator.hasStarted());
  EXPECT_FALSE(estimator.begin(state)) << "it has begun";
  EXPECT_LT(distance(estimator.state().world_T_imu.matrix(), state.world_T_imu.matrix()), 1e-9);
  EXPECT_LT(
      relativeDistance(estimator.state().pose_covariance, Matrix6d(state.covariance.topLeftCorner<6, 6>())),
      1e-6);
  while (flight.seconds() < 5.0) flight.feed(estimator);
  const SE3 truth = flight.pose(flight.lastSeconds());
  EXPECT_LT((estimator.state().world_T_imu.translation() - truth.translation()).norm(), 0.08);
  EXPECT_LT(so3::Log(estimator.state().world_T_imu.rotation().transpose() * truth.rotation()).norm(), 0.03);
}

TEST(InertialStart, DoesNotGoOnFromAStateOfLongAgo) {
  for (const double gap : {600.0, 1e5, 1.6e9, -100.0}) {
    const FlightOptions options = startFlight(false);
    Flight flight(4, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    InitialState state = rightState(flight);
    if (gap != 600.0) state.stamp -= fromSeconds(gap);
    EXPECT_TRUE(estimator.begin(state));
    if (gap == 600.0) flight.skip(gap);
    flight.feedSample(estimator, [](auto&) {});
    EXPECT_FALSE(estimator.hasStarted());
    flight.feed(estimator);
    const std::string problem = rounded(std::abs(gap)) + (gap < 0.0 ? " s newer" : " s older");
    EXPECT_NE(estimator.startProblem().find(problem + " than the first measurement"), std::string::npos)
        << estimator.startProblem();
    // Then it starts by itself.
    for (int i = 0; i < 30 && !estimator.hasStarted(); ++i) flight.feed(estimator);
    EXPECT_TRUE(estimator.hasStarted()) << estimator.startProblem();
  }
}

TEST(InertialStart, KeepsNoMoreThanItNeedsWhereNoImuComes) {
  const FlightOptions options = startFlight(false);
  Flight flight(4, options);
  InertialAlignment alignment(inertialConfig(options, options.pixel));
  alignment.setRig(exampleRig());
  for (int i = 0; i < 200; ++i) {
    flight.skip(0.1);
    flight.sample();
    alignment.process(flight.frame());
    EXPECT_LE(alignment.measurements().size(), 21u);
  }
}

// Of such a gyro the filter has an estimate that is none within a frame, and goes back to one that was.
TEST(InertialStart, GoesOnWhereTheFilterBeginsAnewWithinIt) {
  const FlightOptions options = startFlight(false);
  for (const double density : {1e3, 1e4, 1e5, 1e6}) {
    Flight flight(4, options);
    InvariantConfig config = inertialConfig(options, options.pixel);
    config.inertial.noise.gyro_density = density;
    InertialEstimator estimator = inertialEstimator(config);
    EXPECT_NO_THROW(startOf(flight, estimator)) << density;
  }
}

TEST(InertialStart, NeedsMoreTracksThanTheFilterIsToHave) {
  const FlightOptions options = startFlight(false);
  Flight flight(4, options);
  InvariantConfig config = inertialConfig(options, options.pixel);
  config.max_tracked = 5;
  InertialEstimator estimator = inertialEstimator(config);
  for (int i = 0; i < 50 && !estimator.hasStarted(); ++i) flight.feed(estimator);
  EXPECT_TRUE(estimator.hasStarted()) << estimator.startProblem();
}

} // namespace
} // namespace vi_ekf_slam::test

// Is the covariance right? Normalised estimation errors squared over simulated flights, of which the filter
// knows the noise, and begins with an error of the covariance that it is told.

#include "../flight.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr int kSeeds = 50;

using Vector15d = Eigen::Matrix<double, 15, 1>;

FlightOptions noisyFlight() {
  FlightOptions options;
  options.imu_rate = 100.0;
  options.noise = {1e-3, 1e-2, 1e-4, 1e-3};
  options.pixel = 0.5;
  options.points = 80;
  options.gyro_bias = {0.02, -0.01, 0.03};
  options.accelerometer_bias = {0.1, -0.05, 0.08};
  return options;
}

/// Errors of the pose, velocity and biases by their definition, and their covariance's verdict.
double neesOf(const Flight& truth, const SavedMap& map, const Eigen::VectorXi& rows) {
  const SE3 pose = truth.pose(truth.lastSeconds());
  const Eigen::Matrix3d R = pose.rotation() * map.world_T_imu.rotation().transpose();
  Vector15d error;
  error << pose.translation() - map.world_T_imu.translation(), so3::Log(R),
      R.transpose() * truth.velocity(truth.lastSeconds()) - savedVariable(map, Inertial::kVelocity),
      truth.gyroBias() - savedVariable(map, Inertial::kGyroBias),
      truth.accelerometerBias() - savedVariable(map, Inertial::kAccelerometerBias);
  Eigen::MatrixXd P(rows.size(), rows.size());
  Eigen::VectorXd e(rows.size());
  for (Eigen::Index i = 0; i < rows.size(); ++i) {
    e[i] = error[rows[i]];
    for (Eigen::Index j = 0; j < rows.size(); ++j) P(i, j) = map.covariance(rows[i], rows[j]);
  }
  return e.dot(inverseOf(P) * e);
}

/// Mean of `kSeeds` chi-squares: within 3.3 standard deviations, once in a thousand not.
void expectChiSquare(double mean, int dof, const std::string& what) {
  const double sigma = std::sqrt(2.0 * dof / kSeeds);
  EXPECT_GT(mean, dof - 3.3 * sigma) << what;
  EXPECT_LT(mean, dof + 3.3 * sigma) << what;
}

TEST(InertialConsistency, ErrorsOfPoseVelocityAndBiasesAreThoseOfTheirCovariance) {
  Vector15d sigma;
  sigma << 0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.05, 0.05, 0.05, 5e-3, 5e-3, 5e-3, 0.05, 0.05, 0.05;
  const std::vector<double> times{1.0, 4.0, 10.0};
  std::vector<double> mean(times.size(), 0.0);
  const Eigen::VectorXi all = Eigen::VectorXi::LinSpaced(15, 0, 14);
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    Flight flight(seed, noisyFlight());
    InertialEstimator estimator = inertialEstimator(inertialConfig(noisyFlight()));
    estimator.begin(flight.initialState(sigma, sigma.cwiseProduct(flight.random().gaussian<15>(1.0))));
    for (std::size_t k = 0; k < times.size(); ++k) {
      while (flight.seconds() < times[k] - 1e-6) {
        const FrameReport report = flight.feed(estimator);
        ASSERT_EQ(report.divergence, Divergence::kNone) << seed;
        ASSERT_FALSE(report.frame_rejected) << seed;
      }
      mean[k] += neesOf(flight, estimator.savedMap()(), all) / kSeeds;
    }
  }
  for (std::size_t k = 0; k < times.size(); ++k)
    expectChiSquare(mean[k], 15, "at " + std::to_string(times[k]) + " s");
}

// Of disparities of 1.4 to 3.2 px with a noise of 1.4: where small ones are left out, all come nearer.
TEST(InertialConsistency, FarLandmarksAreNotDrawnNearer) {
  constexpr unsigned kFlights = 10;
  Vector15d sigma;
  sigma << 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 2e-4, 2e-4, 2e-4, 0.02, 0.02, 0.02;
  FlightOptions options = noisyFlight();
  options.farther = 20.0;
  options.pixel = 1.0;
  double mean = 0.0;
  for (unsigned seed = 0; seed < kFlights; ++seed) {
    Flight flight(300 + seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    estimator.begin(flight.initialState(sigma, sigma.cwiseProduct(flight.random().gaussian<15>(1.0))));
    while (flight.seconds() < 10.0) flight.feed(estimator);
    mean += neesOf(flight, estimator.savedMap()(), Eigen::VectorXi::LinSpaced(9, 0, 8)) / kFlights;
  }
  EXPECT_LT(mean, 9.0 + 3.3 * std::sqrt(18.0 / kFlights)) << "pose and velocity";
}

// Where noise is as large as what disparities differ by, a start that fits rotation and velocity to them as
// they are has too small a velocity, and a gyro bias that takes up the rest.
TEST(InertialConsistency, AStartByItselfKnowsHowFastAndHowTurnedItIs) {
  constexpr unsigned kFlights = 20;
  FlightOptions options = noisyFlight();
  options.motion = 2.0;
  options.farther = 4.0;
  options.pixel = 2.0;
  double mean = 0.0;
  for (unsigned seed = 0; seed < kFlights; ++seed) {
    Flight flight(500 + seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options, options.pixel));
    while (!estimator.hasStarted() && flight.seconds() < 10.0) flight.feed(estimator);
    ASSERT_TRUE(estimator.hasStarted()) << seed << ": " << estimator.startProblem();
    mean += neesOf(flight, estimator.savedMap()(), Eigen::VectorXi::LinSpaced(6, 9, 14)) / kFlights;
  }
  EXPECT_LT(mean, 6.0 + 3.3 * std::sqrt(12.0 / kFlights)) << "biases";
}

TEST(InertialConsistency, TheImuAloneIsAsWrongAsItSays) {
  Vector15d sigma;
  sigma << 0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02, 2e-4, 2e-4, 2e-4, 0.02, 0.02, 0.02;
  FlightOptions options = noisyFlight();
  options.noise = {2e-4, 2e-3, 2e-5, 1e-3};
  double position = 0.0, all = 0.0;
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    Flight flight(100 + seed, options);
    InertialEstimator estimator = inertialEstimator(inertialConfig(options));
    estimator.begin(flight.initialState(sigma, sigma.cwiseProduct(flight.random().gaussian<15>(1.0))));
    while (flight.seconds() < 30.0) flight.feedSample(estimator, [](auto&) {});
    const SavedMap map = estimator.savedMap()();
    position += neesOf(flight, map, Eigen::VectorXi::LinSpaced(3, 0, 2)) / kSeeds;
    all += neesOf(flight, map, Eigen::VectorXi::LinSpaced(15, 0, 14)) / kSeeds;
  }
  expectChiSquare(position, 3, "position");
  expectChiSquare(all, 15, "all");
}

} // namespace
} // namespace vi_ekf_slam::test

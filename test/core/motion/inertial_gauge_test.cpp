// With gravity the world may be shifted, and turned about the vertical: nothing tells these four directions.
// Its tilt is told.

#include <Eigen/Eigenvalues>
#include <cmath>

#include "inertial_core.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kFrame = 0.1; // s

/// A body that sees points, at some time.
struct SeeingBody {
  SeeingBody(Random& random, const Inertial::Options& options, std::size_t count)
      : scene(randomInertial(random, options)) {
    scene.filter.setCoreCovariance(randomCovariance(random, 15, 1e-2));
    for (std::size_t i = 0; i < count; ++i) addPoint(random);
  }

  void addPoint(Random& random) {
    const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0), random.uniform(5.0, 15.0));
    const StereoPixels z = exampleRig().camera.project(q);
    const auto seen = model().triangulate(scene.filter, z);
    ASSERT_TRUE(seen);
    points.push_back(scene.filter.augment(Chart::kPoint, seen->position, seen->noise, seen->by));
  }
  static StereoModel model() { return StereoModel(exampleRig(), {}); }
  /// The points, up to `offset` px from where they are expected.
  std::vector<LinearMeasurement> seen(Random& random, double offset) const {
    std::vector<LinearMeasurement> all;
    for (const Handle point : points) {
      const Eigen::Vector3d q = model().camTWorld(scene.filter) * scene.filter.variables().point(point);
      if (q.z() < 1.0) continue;
      const StereoPixels off = offset * random.vector<4>(-1.0, 1.0);
      const auto z = model().observe(scene.filter, point, exampleRig().camera.project(q) + off);
      if (z) all.push_back(*z);
    }
    return all;
  }
  Eigen::MatrixXd known() const {
    return informationOf(scene.filter.covariance(), levelGaugeOf(scene.filter));
  }
  /// A tenth of a second of an IMU that is shaken.
  void shake(Random& random, const Inertial::Options& options) {
    const Eigen::Vector3d bias = scene.filter.variables().mean(handleOf(scene.filter, Inertial::kGyroBias));
    const Eigen::Vector3d up =
        scene.filter.pose().rotation().transpose() * Eigen::Vector3d(0.0, 0.0, kGravity);
    const ImuTrack imu =
        steadyImu(options, bias + random.vector<3>(-0.3, 0.3), up + random.vector<3>(-2.0, 2.0), kFrame);
    scene.propagate(imu, 0.0, kFrame, 10);
    scene.filter.settle();
  }

  InertialScene scene;
  std::vector<Handle> points;
};

/// The largest eigenvalue of `a` beside `b`, minus 1: by how much more of some direction is known.
double learned(const Eigen::MatrixXd& now, const Eigen::MatrixXd& before) {
  return Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd>(now, before).eigenvalues().maxCoeff() -
         1.0;
}

Inertial::Options noisyImu() {
  Inertial::Options options;
  options.noise = {1e-3, 1e-2, 1e-4, 1e-3};
  options.noise_given = true;
  return options;
}

TEST(LevelGauge, NoPointTellsIt) {
  Random random(1);
  for (int run = 0; run < 10; ++run) {
    const SeeingBody body(random, noisyImu(), 5);
    const auto all = body.seen(random, 2.0);
    ASSERT_EQ(all.size(), 5u);
    for (const LinearMeasurement& z : all)
      EXPECT_EQ(
          (denseOf(z, body.scene.filter.rows()) * levelGaugeOf(body.scene.filter)).cwiseAbs().maxCoeff(),
          0.0);
  }
}

TEST(LevelGauge, ThePropagationTakesItToItself) {
  Random random(2);
  for (int run = 0; run < 10; ++run) {
    SeeingBody body(random, withoutImuNoise(), 0);
    // Errors along the gauge alone.
    const Eigen::MatrixXd before = levelGaugeOf(body.scene.filter);
    body.scene.filter.setCoreCovariance(before * before.transpose());
    body.shake(random, withoutImuNoise());
    const Eigen::MatrixXd now = levelGaugeOf(body.scene.filter);
    EXPECT_GT(distance(now, before), 1e-3) << "it has moved";
    EXPECT_LT(relativeDistance(body.scene.filter.covariance(), now * now.transpose()), 1e-12);
    // A tilt is none of it: it becomes a velocity.
    const Eigen::MatrixXd tilts = gaugeOf(body.scene.filter).middleCols(3, 2);
    body.scene.filter.setCoreCovariance(tilts * tilts.transpose());
    body.shake(random, withoutImuNoise());
    EXPECT_NEAR(body.scene.filter.covariance()(6, 6), std::pow(kGravity * kFrame, 2), 1e-9);
  }
}

TEST(LevelGauge, IsNeverLearnedWhateverIsMeasured) {
  Random random(3);
  SeeingBody body(random, noisyImu(), 8);
  Eigen::MatrixXd before = body.known();
  const auto expectNotLearned = [&](const char* what, int frame) {
    const Eigen::MatrixXd now = body.known();
    EXPECT_LT(learned(now, before), 1e-6) << what << ", frame " << frame;
    before = now;
  };
  for (int frame = 0; frame < 60 && !HasFailure(); ++frame) {
    body.shake(random, noisyImu());
    expectNotLearned("propagation", frame);
    const auto all = body.seen(random, 1.0);
    if (!all.empty()) correctSeen(body.scene.filter, all, body.model());
    expectNotLearned("frame", frame);
    VelocitySample velocity;
    velocity.linear_velocity =
        body.scene.filter.pose().rotation().transpose() * body.scene.velocity() + random.vector<3>(-0.1, 0.1);
    body.scene.filter.correct(body.scene.motion.measure(body.scene.filter, velocity));
    body.scene.filter.settle();
    expectNotLearned("velocity", frame);
    if (frame % 5 == 0) {
      body.scene.filter.remove(body.points.front());
      body.points.erase(body.points.begin());
      body.addPoint(random);
      expectNotLearned("augmentation", frame);
    }
    if (frame == 30) {
      const Eigen::Vector3d rate =
          body.scene.filter.variables().mean(handleOf(body.scene.filter, Inertial::kGyroBias));
      body.scene.motion.processStandstill(body.scene.filter,
                                          steadyImu(noisyImu(), rate, Eigen::Vector3d::Zero(), 1.0),
                                          fromSeconds(0.5), 0.1);
      body.scene.filter.settle();
      expectNotLearned("standstill", frame);
    }
  }
}

// The rate that it is told is one sample's, with that one's noise, however long ago the last frame was.
TEST(InertialStandstillUpdate, TellsOfTheGyrosBiasWhatASampleTells) {
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  Inertial::Options options;
  options.noise_given = true;
  options.noise.gyro_density = 0.002;
  InertialScene scene(options);
  const double prior = 0.01, sample = 0.002 * 0.002 * 1000.0; // (rad/s)^2, of 1000 Hz
  const Handle bias = handleOf(scene.filter, Inertial::kGyroBias);
  scene.filter.makeIndependent(scene.filter.rowOf(bias), isotropic(std::sqrt(prior)));
  ImuTrack imu(options.noise, true);
  for (const double t : {0.0, 0.001}) imu.reach(imuSample(t, none, {0.0, 0.0, kGravity}));
  scene.motion.processStandstill(scene.filter, imu, fromSeconds(0.001), 0.2);
  const double known = scene.filter.covariance(bias)(0, 0);
  EXPECT_NEAR(known, prior * sample / (prior + sample), 0.02 * known);
}

TEST(LevelGauge, TiltIsLearnedAndTheHeadingIsNot) {
  Random random(4);
  InertialScene scene(noisyImu());
  SeeingBody body(random, noisyImu(), 0);
  body.scene = scene;
  Eigen::VectorXd variance = Eigen::VectorXd::Constant(15, 1.0);
  variance.segment<3>(3).setConstant(0.04);
  variance.tail<6>().setConstant(1e-4);
  body.scene.filter.setCoreCovariance(Eigen::MatrixXd(variance.asDiagonal()));
  for (int i = 0; i < 12; ++i) body.addPoint(random);
  for (int frame = 0; frame < 20; ++frame) {
    body.shake(random, noisyImu());
    const auto all = body.seen(random, 0.0);
    if (!all.empty()) correct(body.scene.filter, all);
  }
  const Eigen::VectorXd now = body.scene.filter.covariance().diagonal().head<6>().cwiseSqrt();
  EXPECT_LT(now.segment<2>(3).maxCoeff(), 0.02);
  EXPECT_GE(now[5], 0.2);
  EXPECT_GE(now.head<3>().minCoeff(), 1.0);
}

} // namespace
} // namespace vi_ekf_slam::test

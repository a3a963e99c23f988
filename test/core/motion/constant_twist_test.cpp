#include "vi_ekf_slam/core/motion/constant_twist.hpp"

#include <cmath>

#include "../filter/states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// `state` of `scene`'s variables after `dt`: the body moves on, the world does not.
State moved(const Scene& scene, State state, double dt) {
  const Vector6d twist =
      state.x.segment<6>(scene.filter.rowOf(handleOf(scene.filter, ConstantTwist::kTwist)));
  state.pose = state.pose * SE3::Exp(dt * twist);
  return state;
}

Scene without(const Scene& scene) {
  Scene still = scene;
  still.motion = ConstantTwist(withoutNoise(noisyMotion()));
  Filter added(SE3{}, Matrix6d::Identity());
  still.motion.addTo(added); // the same handles
  return still;
}

TEST(ConstantTwistModel, StartsAtRestWithItsPrior) {
  Filter filter(SE3(), 0.01 * Matrix6d::Identity());
  ConstantTwist motion(noisyMotion());
  motion.addTo(filter);
  filter.closeCore();
  EXPECT_EQ(motion.twist(filter, kNoImu, 0), Vector6d::Zero());
  EXPECT_EQ(motion.bias(filter), Vector6d::Zero());
  Eigen::VectorXd variance(18);
  variance << Vector6d::Constant(0.01), Vector6d::Constant(0.09), Vector6d::Constant(0.0004);
  const Eigen::MatrixXd expected = variance.asDiagonal();
  EXPECT_LT(distance(filter.covariance(), expected), 1e-15);
}

TEST(ConstantTwistModel, PropagatesTheErrorAsTheExactDynamicsDo) {
  Random random(1);
  for (int run = 0; run < 5; ++run) {
    Scene scene = without(busyScene(random));
    const State before = stateOf(scene.filter);
    const Variables variables = scene.filter.variables();
    const Eigen::MatrixXd P = scene.filter.covariance(), N = gaugeOf(scene.filter);
    const double dt = random.uniform(0.02, 0.3);
    const State after = moved(scene, before, dt);
    const Eigen::MatrixXd F = derivative(
        [&](const Eigen::VectorXd& error) {
          return errorOf(variables, moved(scene, truthAt(variables, before, error), dt), after);
        },
        P.rows());
    scene.motion.propagate(scene.filter, dt);
    EXPECT_LT(distance(scene.filter.pose().matrix(), after.pose.matrix()), 1e-12);
    const Eigen::Index c = scene.filter.coreRows();
    EXPECT_LT(relativeDistance(scene.filter.covariance().topLeftCorner(c, c),
                               (F * P * F.transpose()).topLeftCorner(c, c)),
              1e-8);
    scene.filter.settle();
    EXPECT_LT(relativeDistance(scene.filter.covariance(), F * P * F.transpose()), 1e-8);
    EXPECT_LT(distance(F * N, gaugeOf(scene.filter)), 1e-8);
    EXPECT_LT(distance(stateOf(scene.filter).x, after.x), 1e-12);
    expectCovariance(scene.filter.covariance());
  }
}

TEST(ConstantTwistModel, AddsTheSameNoiseInOneStepAsInTen) {
  // At rest the map from twist to pose is constant, and both are exact.
  Random random(2);
  Filter one(SE3(), 0.01 * Matrix6d::Identity());
  ConstantTwist motion(noisyMotion());
  motion.addTo(one);
  one.closeCore();
  one.augment(Chart::kPoint, Eigen::Vector3d(5.0, 2.0, 1.0), 0.1 * Eigen::Matrix3d::Identity());
  Filter ten = one;
  motion.propagate(one, 1.0);
  for (int i = 0; i < 10; ++i) motion.propagate(ten, 0.1);
  one.settle();
  ten.settle();
  EXPECT_LT(distance(one.covariance(), ten.covariance()), 1e-13);
  const Vector6d Q = noisyMotion().twist_density.cwiseAbs2();
  const Vector6d prior = noisyMotion().prior_twist_sigma.cwiseAbs2();
  const Eigen::MatrixXd P = one.covariance();
  const Eigen::Index t = one.rowOf(handleOf(one, ConstantTwist::kTwist)),
                     b = one.rowOf(handleOf(one, ConstantTwist::kBias));
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(P(t + i, t + i), prior[i] + Q[i], 1e-13);
    EXPECT_NEAR(P(i, i), 0.01 + prior[i] + Q[i] / 3.0, 1e-13);
    EXPECT_NEAR(P(i, t + i), prior[i] + Q[i] / 2.0, 1e-13);
    EXPECT_NEAR(P(b + i, b + i), 0.0004 + std::pow(noisyMotion().bias_density[i], 2), 1e-13);
  }
}

TEST(ConstantTwistModel, NoiseDoesNotDependOnTheStepToFirstOrder) {
  Random random(2);
  const Scene start = busyScene(random), quiet = without(start);
  const Eigen::Index t = start.filter.rowOf(handleOf(start.filter, ConstantTwist::kTwist));
  const auto difference = [&](double dt) {
    // The noise alone: what it adds to the propagation without.
    const auto added = [&](int steps) {
      Scene with = start, none = quiet;
      for (int i = 0; i < steps; ++i) {
        with.motion.propagate(with.filter, dt / steps);
        none.motion.propagate(none.filter, dt / steps);
      }
      return Eigen::MatrixXd(with.filter.covariance() - none.filter.covariance());
    };
    const Eigen::MatrixXd one = added(1), ten = added(10);
    // Block by block, since they are of different orders in dt.
    return Eigen::Vector3d(relativeDistance(one.block<6, 6>(0, 0), ten.block<6, 6>(0, 0)),
                           relativeDistance(one.block<6, 6>(0, t), ten.block<6, 6>(0, t)),
                           relativeDistance(one.block<6, 6>(t, t), ten.block<6, 6>(t, t)));
  };
  const Eigen::Vector3d coarse = difference(0.02), fine = difference(0.01);
  EXPECT_LT(coarse.maxCoeff(), 0.05);
  for (int i = 0; i < 3; ++i) EXPECT_LE(fine[i], 0.6 * coarse[i] + 1e-9);
}

TEST(ConstantTwistModel, TakesASamplesOwnCovarianceOrTheConfiguredOne) {
  const ConstantTwist motion(noisyMotion());
  ImuSample gyro;
  VelocitySample velocity;
  EXPECT_LT(distance(motion.noiseOf(gyro), isotropic(0.05)), 1e-15);
  EXPECT_LT(distance(motion.noiseOf(velocity), isotropic(0.5)), 1e-15);
  gyro.covariance = velocity.covariance = isotropic(0.3);
  EXPECT_EQ(motion.noiseOf(gyro), isotropic(0.3));
  EXPECT_EQ(motion.noiseOf(velocity), isotropic(0.3));
}

TEST(ConstantTwistModel, ASampleMeasuresTheTwistAndItsBias) {
  Random random(11);
  const Scene start = busyScene(random);
  const Vector6d measured = start.motion.twist(start.filter, kNoImu, 0) + 0.1 * random.vector<6>(-1.0, 1.0);
  ImuSample gyro;
  gyro.angular_velocity = measured.tail<3>();
  gyro.covariance = isotropic(1e-5);
  VelocitySample velocity;
  velocity.linear_velocity = measured.head<3>();
  velocity.covariance = isotropic(1e-5);
  Scene scene = start;
  scene.motion.process(scene.filter, gyro);
  scene.filter.correct(scene.motion.measure(scene.filter, velocity));
  EXPECT_LT(distance(scene.motion.twist(scene.filter, kNoImu, 0) + scene.motion.bias(scene.filter), measured),
            1e-4);
  EXPECT_EQ(scene.motion.gyroBias(scene.filter), scene.motion.bias(scene.filter).tail<3>());
  // A bias is told as far as it was unknown beside the twist.
  EXPECT_GT(distance(scene.motion.bias(scene.filter), start.motion.bias(start.filter)), 1e-5);
}

TEST(ConstantTwistModel, ResetsToItsPrior) {
  Random random(12);
  for (const bool biases : {false, true}) {
    Scene scene = busyScene(random);
    const Vector6d twist = scene.motion.twist(scene.filter, kNoImu, 0);
    const Eigen::MatrixXd bias = scene.filter.covariance(handleOf(scene.filter, ConstantTwist::kBias));
    scene.motion.reset(scene.filter, biases);
    EXPECT_EQ(scene.motion.twist(scene.filter, kNoImu, 0), twist);
    EXPECT_LT(distance(scene.motion.twistCovariance(scene.filter, kNoImu), 0.09 * Matrix6d::Identity()),
              1e-15);
    const Eigen::MatrixXd expected = biases ? Eigen::MatrixXd(0.0004 * Matrix6d::Identity()) : bias;
    EXPECT_LT(distance(scene.filter.covariance(handleOf(scene.filter, ConstantTwist::kBias)), expected),
              1e-15);
    expectCovariance(scene.filter.covariance());
  }
}

TEST(ConstantTwistModel, TakesWhatIsKnownOfTheBiasesAsTheirPriorFromThenOn) {
  Random random(13);
  Scene scene = busyScene(random);
  const TwistBias known{random.vector<6>(-0.1, 0.1), Vector6d::LinSpaced(0.01, 0.06)};
  const Eigen::MatrixXd expected = known.sigma.cwiseAbs2().asDiagonal();
  scene.motion.setBiasPrior(scene.filter, known);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(scene.motion.bias(scene.filter), known.mean);
    EXPECT_LT(distance(scene.filter.covariance(handleOf(scene.filter, ConstantTwist::kBias)), expected),
              1e-15);
    expectCovariance(scene.filter.covariance());
    scene.motion.process(scene.filter, ImuSample{0, Eigen::Vector3d::Ones(), {}});
    EXPECT_NE(scene.motion.bias(scene.filter), known.mean);
    scene.motion.reset(scene.filter, true);
  }
}

/// A vehicle's densities and priors, seen along a camera's axes: z is what was x, x was y, y was z.
TEST(ConstantTwistModel, TurnsItsOptionsOnceForABodyWithACamerasAxes) {
  ConstantTwist::Options options;
  options.prior_twist_sigma << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0;
  options.prior_bias_sigma << 0.1, 0.2, 0.3, 0.4, 0.5, 0.6;
  options.twist_density << 10.0, 20.0, 30.0, 40.0, 50.0, 60.0;
  Filter filter(SE3(), Matrix6d::Identity());
  ConstantTwist motion(options);
  EXPECT_TRUE(motion.startPose().rotation().isIdentity());
  motion.setOpticalBody();
  motion.setOpticalBody();
  motion.addTo(filter);
  filter.closeCore();
  const Vector6d expected = (Vector6d() << 2.0, 3.0, 1.0, 5.0, 6.0, 4.0).finished();
  EXPECT_EQ(Vector6d(motion.twistCovariance(filter, kNoImu).diagonal().cwiseSqrt()), expected);
  EXPECT_LT(distance(filter.covariance(handleOf(filter, ConstantTwist::kBias)).diagonal().cwiseSqrt(),
                     0.1 * expected),
            1e-12);
  motion.propagate(filter, 1.0);
  const Vector6d grown = motion.twistCovariance(filter, kNoImu).diagonal() - Vector6d(expected.cwiseAbs2());
  EXPECT_LT(distance(grown, 100.0 * expected.cwiseAbs2()), 1e-9);
  // It looks along the world's x axis then, which has a vehicle's axes.
  const Eigen::Matrix3d world_R_body = motion.startPose().rotation();
  EXPECT_EQ(Eigen::Vector3d::UnitX(), world_R_body * Eigen::Vector3d::UnitZ());
  EXPECT_EQ(Eigen::Vector3d::UnitZ(), world_R_body * -Eigen::Vector3d::UnitY());
}

TEST(ConstantTwistModel, ChangeOfTheTwistIsInUnitsOfItsCovariance) {
  Random random(13);
  const Scene scene = busyScene(random);
  const Eigen::VectorXd error = randomMatrix(random, scene.filter.coreRows(), 1);
  const Vector6d change = error.segment<6>(scene.filter.rowOf(handleOf(scene.filter, ConstantTwist::kTwist)));
  const Eigen::MatrixXd P = scene.motion.twistCovariance(scene.filter, kNoImu);
  const double expected = change.dot(inverseOf(P) * change);
  EXPECT_NEAR(scene.motion.twistChange(scene.filter, error), expected, 1e-9 * expected);
}

} // namespace
} // namespace vi_ekf_slam::test

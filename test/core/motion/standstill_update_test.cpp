// What it tells a filter that the body stands still.

#include <cmath>

#include "../filter/states.hpp"
#include "vi_ekf_slam/core/observation/body_twist.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(StandstillUpdate, IsTheTextbooksUpdateByATwistOfZero) {
  Random random(40);
  for (const double dt : {1.0 / 30.0, 0.1, 0.2}) {
    Scene scene = busyScene(random);
    const LinearMeasurement z =
        measureStandstill(scene.filter, handleOf(scene.filter, ConstantTwist::kTwist), dt);
    const Eigen::MatrixXd P = scene.filter.covariance(), H = denseOf(z, P.rows());
    const Eigen::Index t = scene.filter.rowOf(handleOf(scene.filter, ConstantTwist::kTwist));
    Eigen::MatrixXd expected_H = Eigen::MatrixXd::Zero(6, P.rows());
    expected_H.middleCols<6>(t).setIdentity();
    EXPECT_EQ(distance(H, expected_H), 0.0);
    EXPECT_EQ(distance(Vector6d(z.residual()), -scene.motion.twist(scene.filter, kNoImu, 0)), 0.0);
    const Eigen::MatrixXd K =
        P * H.transpose() * inverseOf(H * P * H.transpose() + Eigen::MatrixXd(z.noise()));
    const Vector6d twist =
        scene.motion.twist(scene.filter, kNoImu, 0) + (K * Eigen::VectorXd(z.residual())).segment<6>(t);
    scene.motion.processStandstill(scene.filter, kNoImu, 0, dt);
    EXPECT_LT(distance(scene.motion.twist(scene.filter, kNoImu, 0), twist), 1e-10);
    EXPECT_LT(distance(scene.motion.twistCovariance(scene.filter, kNoImu), (P - K * H * P).block(t, t, 6, 6)),
              1e-10);
    // It stands now, and is known to.
    for (int i = 0; i < 6; ++i)
      EXPECT_LE(scene.motion.twistCovariance(scene.filter, kNoImu)(i, i), z.noise()(i, i)) << i;
    scene.filter.settle();
    expectCovariance(scene.filter.covariance());
  }
}

TEST(StandstillUpdate, TellsTheSamePerSecondAtWhateverRate) {
  const auto informationPerSecond = [](double rate) {
    Random random(41);
    Scene scene = coreScene(random, 0.0, withoutNoise(noisyMotion()));
    const Matrix6d before = inverseOf(scene.motion.twistCovariance(scene.filter, kNoImu));
    for (int i = 0; i < static_cast<int>(2.0 * rate); ++i)
      scene.motion.processStandstill(scene.filter, kNoImu, 0, 1.0 / rate);
    return Matrix6d(0.5 * (inverseOf(scene.motion.twistCovariance(scene.filter, kNoImu)) - before));
  };
  const Matrix6d expected = informationPerSecond(10.0);
  for (const double rate : {5.0, 30.0, 100.0})
    EXPECT_LT(relativeDistance(informationPerSecond(rate), expected), 1e-9) << rate;
  // As long as nothing is said nothing is told.
  EXPECT_GT(expected(0, 0), 1e3);
}

TEST(StandstillUpdate, LeavesTheSameTwistAndBiasAtWhateverRate) {
  // With the model of motion between, which lets the twist walk a little until it is said again, and a gyro
  // at 100 Hz.
  const auto after = [](int every) {
    Random random(42);
    ConstantTwist::Options options = noisyMotion();
    options.bias_density.setZero();
    Scene scene = coreScene(random, 0.0, options);
    ImuSample gyro;
    gyro.angular_velocity = {0.01, -0.02, 0.03};
    gyro.covariance = isotropic(0.05);
    for (int i = 1; i <= 1000; ++i) {
      scene.motion.propagate(scene.filter, 0.01);
      scene.motion.process(scene.filter, gyro);
      if (i % every == 0) scene.motion.processStandstill(scene.filter, kNoImu, 0, 0.01 * every);
    }
    scene.filter.settle();
    return scene;
  };
  const Scene five = after(20), ten = after(10), fifty = after(2);
  for (const Scene* scene : {&five, &fifty}) {
    EXPECT_LT(distance(scene->motion.gyroBias(scene->filter), ten.motion.gyroBias(ten.filter)), 2e-4);
    for (int i = 0; i < 3; ++i) {
      const double expected = std::sqrt(ten.motion.gyroBiasCovariance(ten.filter)(i, i));
      EXPECT_NEAR(std::sqrt(scene->motion.gyroBiasCovariance(scene->filter)(i, i)), expected,
                  0.25 * expected);
    }
  }
}

TEST(StandstillUpdate, LetsASensorTellItsBias) {
  Random random(43);
  ConstantTwist::Options options = noisyMotion();
  options.bias_density.setZero();
  Scene scene = coreScene(random, 0.0, options);
  ImuSample gyro;
  gyro.angular_velocity = {0.01, -0.02, 0.03};
  gyro.covariance = isotropic(0.01);
  for (int i = 0; i < 200; ++i) {
    scene.motion.propagate(scene.filter, 0.1);
    scene.motion.processStandstill(scene.filter, kNoImu, 0, 0.1);
    scene.motion.process(scene.filter, gyro);
  }
  EXPECT_LT(distance(scene.motion.gyroBias(scene.filter), gyro.angular_velocity), 1e-3);
  EXPECT_LT(scene.motion.twist(scene.filter, kNoImu, 0).norm(), 2e-3);
  // 200 samples of 0.01 rad/s, of a twist known to 0.002, beside a prior of 0.02 rad/s.
  const double sigma = std::sqrt(scene.motion.gyroBiasCovariance(scene.filter)(2, 2));
  EXPECT_NEAR(sigma, 1.0 / std::sqrt(200.0 / 1.04e-4 + 1.0 / 4e-4), 0.1 * sigma);
}

} // namespace
} // namespace vi_ekf_slam::test

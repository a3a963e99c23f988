#include "states.hpp"
#include "vi_ekf_slam/core/invariant/inverse_depth.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

TEST(InvariantStereo, ObservesByTheRelativePositionAlone) {
  Random random(11);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  const State state = busyState(random);
  const Mean estimate = meanOf(state);
  const auto predict = [&](const Mean& mean, std::size_t i) {
    const StereoPixels z =
        model.rig().camera.project(model.rig().cam_T_imu * mean.pose.inverse() * mean.landmarks[i]);
    return Eigen::Vector3d(z[0], 0.5 * (z[1] + z[3]), z[2]);
  };
  for (std::size_t i = 0; i < 3; ++i) {
    const StereoPixels pixels(700.0, 200.0, 650.0, 201.0);
    const auto seen = model.observe(state, i, pixels);
    ASSERT_TRUE(seen);
    EXPECT_EQ(seen->landmark, i);
    EXPECT_LT(distance(seen->innovation, Eigen::Vector3d(700.0, 200.5, 650.0) - predict(estimate, i)), 1e-9);
    const Eigen::MatrixXd H = derivative(
        [&](const Eigen::VectorXd& error) -> Eigen::VectorXd { return predict(truthAt(estimate, error), i); },
        state.size());
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(3, state.size());
    expected.middleCols<3>(State::offsetOf(i)) = seen->jacobian;
    expected.middleCols<3>(kPosition) = -seen->jacobian;
    EXPECT_LT(relativeDistance(H, expected), 1e-6);
    EXPECT_EQ((expected * gauge(state)).cwiseAbs().maxCoeff(), 0.0);

    // The whole world shifted or turned, and not by a little.
    const Eigen::VectorXd world = gauge(state) * (Vector6d() << 30.0, -5.0, 2.0, 0.2, -0.3, 2.0).finished();
    Eigen::VectorXd turned = world;
    turned.segment<3>(kPosition).setZero();
    for (std::size_t j = 0; j < 3; ++j) turned.segment<3>(State::offsetOf(j)).setZero();
    EXPECT_LT(distance(predict(truthAt(estimate, turned), i), predict(estimate, i)), 1e-9);
    EXPECT_LT(distance(predict(truthAt(estimate, world - turned), i), predict(estimate, i)), 1e-9);
  }
}

TEST(InvariantStereo, StacksPHtAndS) {
  Random random(12);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  const State state = busyState(random);
  PooledVector<Observation> observations = observationsOf(model, state, 1.0, random);
  std::swap(observations[0], observations[2]);
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(9, state.size());
  for (std::size_t i = 0; i < 3; ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    H.block<3, 3>(row, kPosition) = -observations[i].jacobian;
    H.block<3, 3>(row, State::offsetOf(observations[i].landmark)) = observations[i].jacobian;
    EXPECT_EQ(distance(stackInnovations(observations).segment<3>(row), observations[i].innovation), 0.0);
  }
  Eigen::MatrixXd noise = Eigen::MatrixXd::Zero(9, 9);
  for (Eigen::Index i = 0; i < 9; i += 3) noise.block<3, 3>(i, i) = model.noise();
  const Update expected = updateOf(state, H, noise);
  const Eigen::MatrixXd PHt = model.crossCovariance(state, observations);
  EXPECT_LT(relativeDistance(PHt, expected.PHt), 1e-12);
  const Eigen::MatrixXd S = model.innovationCovariance(observations, PHt);
  EXPECT_LT(relativeDistance(Eigen::MatrixXd(S.selfadjointView<Eigen::Lower>()), expected.S), 1e-12);
  const Eigen::Matrix3d expected_noise = Eigen::Vector3d(0.49, 0.245, 0.49).asDiagonal();
  EXPECT_LT(distance(model.noise(), expected_noise), 1e-15);
}

TEST(InvariantStereo, TriangulatesWithinItsRange) {
  Random random(13);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  State state = busyState(random, 1);
  const SE3 world_T_cam = state.pose() * model.rig().cam_T_imu.inverse();
  const auto pixels = [&](double depth) {
    return model.rig().camera.project(Eigen::Vector3d(0.1 * depth, -0.05 * depth, depth));
  };
  EXPECT_FALSE(model.triangulate(state, pixels(0.4), 100.0));
  EXPECT_FALSE(model.triangulate(state, pixels(101.0), 100.0));
  const auto sighting = model.triangulate(state, pixels(20.0), 100.0);
  ASSERT_TRUE(sighting);
  EXPECT_LT(distance(sighting->position, world_T_cam * Eigen::Vector3d(2.0, -1.0, 20.0)), 1e-9);
  // Seen in pixels the new landmark is as uncertain as the pixels are.
  state.addLandmark(7, sighting->position, sighting->covariance);
  const auto seen = model.observe(state, 1, pixels(20.0));
  ASSERT_TRUE(seen);
  EXPECT_LT(seen->innovation.norm(), 1e-9);
  const PooledVector<Observation> one{*seen};
  const Eigen::MatrixXd S = model.innovationCovariance(one, model.crossCovariance(state, one));
  EXPECT_LT(distance(S, 2.0 * model.noise()), 1e-9);
}

TEST(InvariantStereo, DoesNotSeeBehindItself) {
  Random random(14);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  State state = busyState(random, 0);
  const SE3 world_T_cam = state.pose() * model.rig().cam_T_imu.inverse();
  for (const double z : {-5.0, 0.0, 0.49, 0.51}) {
    state.addLandmark(1, world_T_cam * Eigen::Vector3d(0.1, 0.1, z), Eigen::Matrix3d::Identity());
    const bool seen = model.observe(state, state.landmarks().size() - 1, {600, 180, 500, 180}).has_value();
    EXPECT_EQ(seen, z > 0.5) << z;
  }
}

TEST(InvariantStereo, LearnsNothingAboutWhereTheWholeWorldIs) {
  Random random(15);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  State state = busyState(random, 6);
  const Eigen::MatrixXd before = information(state, gauge(state));
  for (int frame = 0; frame < 10; ++frame) {
    const auto observations = observationsOf(model, state, 2.0, random);
    const Eigen::MatrixXd PHt = model.crossCovariance(state, observations);
    ASSERT_TRUE(state.apply(
        Correction(PHt, model.innovationCovariance(observations, PHt), stackInnovations(observations)),
        &model.rig().cam_T_imu));
    EXPECT_LT(relativeDistance(information(state, gauge(state)), before), 1e-6) << frame;
    state.propagate(0.02, kNoNoise);
    EXPECT_LT(relativeDistance(information(state, gauge(state)), before), 1e-6) << frame;
    expectCovariance(state);
  }
}

TEST(InverseDepth, JacobiansAreEachOthersInverseAndTheDerivatives) {
  Random random(17);
  for (int run = 0; run < 100; ++run) {
    const Eigen::Vector3d q(random.uniform(-10.0, 10.0), random.uniform(-5.0, 5.0),
                            random.uniform(0.5, 80.0));
    const Eigen::Matrix3d product = InverseDepth::jacobian(q) * InverseDepth::pointJacobian(q);
    EXPECT_LT(distance(product, Eigen::Matrix3d::Identity()), 1e-12);
    const auto coordinates = [](const Eigen::Vector3d& p) {
      return Eigen::Vector3d(p.x() / p.z(), p.y() / p.z(), 1.0 / p.z());
    };
    const Eigen::Matrix3d numeric = numericJacobian<3, 3>(coordinates, q);
    EXPECT_LT(relativeDistance(InverseDepth::jacobian(q), numeric), 1e-8);
    const auto point = [](const Eigen::Vector3d& l) {
      return Eigen::Vector3d(l.x() / l.z(), l.y() / l.z(), 1.0 / l.z());
    };
    const Eigen::Matrix3d back = numericJacobian<3, 3>(point, coordinates(q), 1e-3 / q.z());
    EXPECT_LT(relativeDistance(InverseDepth::pointJacobian(q), back), 1e-8);
  }
}

TEST(InverseDepth, MovesThePointInItsOwnCoordinates) {
  const Eigen::Vector3d q(2.0, -1.0, 20.0);
  EXPECT_LT(distance(InverseDepth::moved(q, Eigen::Vector3d::Zero()), q), 1e-13);
  const Eigen::Vector3d little(1e-4, -2e-4, 1e-3);
  EXPECT_LT(distance(InverseDepth::moved(q, little), q + little), 1e-6);
  // 20 m further, by the derivative nothing is left of the inverse depth: it is held at a fifth.
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, 20.0}).z(), 100.0, 1e-9);
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, 10.0}).z(), 40.0, 1e-9);
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, -20.0}).z(), 10.0, 1e-9);
  EXPECT_NEAR(InverseDepth::moved(q, {0.0, 0.0, 1e6}).z(), 100.0, 1e-9);
  EXPECT_GT(InverseDepth::moved(q, {0.0, 0.0, -1e6}).z(), 0.0);
  EXPECT_TRUE(InverseDepth::isDefined({0.0, 0.0, 0.31}));
  EXPECT_FALSE(InverseDepth::isDefined({0.0, 0.0, 0.29}));
  EXPECT_FALSE(InverseDepth::isDefined({0.0, 0.0, -1.0}));
}

} // namespace
} // namespace vi_ekf_slam::invariant

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "numeric.hpp"
#include "paper_reference.hpp"
#include "vi_ekf_slam/core/invariant/inverse_depth.hpp"
#include "vi_ekf_slam/core/invariant/scale_monitor.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/stereo_update.hpp"
#include "vi_ekf_slam/core/so3.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using test::distance;
using test::exampleRig;
using test::numericJacobian;
using test::Random;
using test::relativeDistance;

const ProcessNoise kNoNoise{Vector6d::Zero(), Vector6d::Zero()};
const ProcessNoise kNoise{(Vector6d() << 0.5, 0.1, 0.2, 0.05, 0.06, 0.07).finished(),
                          (Vector6d() << 0.01, 0.02, 0.03, 0.004, 0.005, 0.006).finished()};
const Prior kPrior{Vector6d::Constant(0.1), Vector6d::Constant(0.3), Vector6d::Constant(0.02)};

Eigen::MatrixXd randomMatrix(Random& random, Eigen::Index rows, Eigen::Index cols) {
  Eigen::MatrixXd A(rows, cols);
  for (Eigen::Index i = 0; i < A.size(); ++i) A(i) = random.uniform(-1.0, 1.0);
  return A;
}

/// The update of a measurement H x with the given noise, as a caller of State puts it.
struct Update {
  Eigen::MatrixXd HP, S;
};

Update updateOf(const State& state, const Eigen::MatrixXd& H, const Eigen::MatrixXd& noise) {
  const Eigen::MatrixXd HP = H * state.covariance();
  return {HP, HP * H.transpose() + noise};
}

Eigen::MatrixXd twistRows(const State& state, Eigen::Index axis) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, state.size());
  H.middleCols<3>(kTwist + axis).setIdentity();
  H.middleCols<3>(kBias + axis).setIdentity();
  return H;
}

/// Far from the origin, moving and turning, `landmarks` of them in view, everything correlated.
State busyState(Random& random, std::size_t landmarks = 3) {
  State state(kPrior);
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(6, state.size());
  H.middleCols<6>(kTwist).setIdentity();
  const Update start = updateOf(state, H, 1e-6 * Matrix6d::Identity());
  const Vector6d twist = (Vector6d() << 8.0, 0.3, -0.2, 0.05, -0.1, 0.4).finished();
  state.correct(start.HP, start.S, twist);
  for (int i = 0; i < 20; ++i) state.propagate(0.1, kNoise);
  const SE3 world_T_cam = state.pose() * exampleRig().cam_T_imu.inverse();
  for (std::size_t i = 0; i < landmarks; ++i) {
    const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0), random.uniform(5.0, 20.0));
    state.addLandmark(10 + i, world_T_cam * q, 0.1 * random.covariance<3>());
  }
  const Eigen::MatrixXd mix = 0.3 * randomMatrix(random, 5, state.size());
  const Update update = updateOf(state, mix, 0.1 * Eigen::MatrixXd::Identity(5, 5));
  state.correct(update.HP, update.S, Eigen::VectorXd::Zero(5));
  state.propagate(0.1, kNoise);
  return state;
}

/// A truth or a mean: what State estimates.
struct Mean {
  SE3 pose;
  Vector6d twist, bias;
  std::vector<Eigen::Vector3d> landmarks;
};

Mean meanOf(const State& state) {
  Mean mean{state.pose(), state.twist(), state.bias(), {}};
  for (const Landmark& l : state.landmarks()) mean.landmarks.push_back(l.position);
  return mean;
}

/// The truth that lies `error` from `estimate`, by the definition of the error.
Mean truthAt(const Mean& estimate, const Eigen::VectorXd& error) {
  Mean truth = estimate;
  truth.pose = SE3::Exp(error.segment<6>(kPosition)) * estimate.pose;
  truth.twist += error.segment<6>(kTwist);
  truth.bias += error.segment<6>(kBias);
  const Eigen::Matrix3d R = so3::Exp(error.segment<3>(kRotation));
  for (std::size_t i = 0; i < truth.landmarks.size(); ++i) {
    truth.landmarks[i] = R * (estimate.landmarks[i] + error.segment<3>(State::offsetOf(i)));
  }
  return truth;
}

Eigen::VectorXd errorOf(const Mean& truth, const Mean& estimate) {
  Eigen::VectorXd error(State::offsetOf(truth.landmarks.size()));
  error.segment<6>(kPosition) = (truth.pose * estimate.pose.inverse()).Log();
  error.segment<6>(kTwist) = truth.twist - estimate.twist;
  error.segment<6>(kBias) = truth.bias - estimate.bias;
  const Eigen::Matrix3d R = so3::Exp(error.segment<3>(kRotation));
  for (std::size_t i = 0; i < truth.landmarks.size(); ++i) {
    error.segment<3>(State::offsetOf(i)) = R.transpose() * truth.landmarks[i] - estimate.landmarks[i];
  }
  return error;
}

/// Numeric derivative of f(error) at no error.
template <typename F>
Eigen::MatrixXd derivative(const F& f, Eigen::Index size) {
  constexpr double h = 1e-3;
  Eigen::MatrixXd J;
  for (Eigen::Index i = 0; i < size; ++i) {
    const auto at = [&](double step) -> Eigen::VectorXd { return f(step * Eigen::VectorXd::Unit(size, i)); };
    const Eigen::VectorXd column = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
    if (i == 0) J.resize(column.size(), size);
    J.col(i) = column;
  }
  return J;
}

Mean moved(Mean mean, double dt) {
  mean.pose = mean.pose * SE3::Exp(dt * mean.twist);
  return mean;
}

/// Directions of the error that move the whole world: three shifts, three rotations about the origin.
Eigen::MatrixXd gauge(const State& state) {
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(state.size(), 6);
  N.block<3, 3>(kPosition, 0).setIdentity();
  N.block<3, 3>(kRotation, 3).setIdentity();
  for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
    N.block<3, 3>(State::offsetOf(i), 0).setIdentity();
  }
  return N;
}

/// What is known about the direction `N` when nothing else is free.
Eigen::MatrixXd information(const State& state, const Eigen::MatrixXd& N) {
  const Eigen::MatrixXd P = state.covariance();
  return N.transpose() * P.ldlt().solve(N);
}

void expectCovariance(const State& state) {
  const Eigen::MatrixXd P = state.covariance();
  EXPECT_LE(distance(P, P.transpose()), 1e-13 * P.cwiseAbs().maxCoeff());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(P);
  EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-13 * eigen.eigenvalues().maxCoeff());
}

/// All landmarks of `state` seen `offset` px from where they are expected.
std::vector<Observation> observationsOf(const StereoModel& model, const State& state, double offset,
                                        Random& random) {
  std::vector<Observation> observations;
  const SE3 cam_T_world = model.rig().cam_T_imu * state.pose().inverse();
  for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
    const StereoPixels expected = model.rig().camera.project(cam_T_world * state.landmarks()[i].position);
    const auto seen = model.observe(state, i, expected + offset * random.vector<4>(-1.0, 1.0));
    EXPECT_TRUE(seen);
    if (seen) observations.push_back(*seen);
  }
  return observations;
}

TEST(InvariantState, StartsAtTheOriginWithItsPrior) {
  const State state(kPrior);
  EXPECT_EQ(distance(state.pose().matrix(), Eigen::Matrix4d::Identity()), 0.0);
  EXPECT_EQ(state.size(), kLandmarks);
  Eigen::VectorXd sigma(18);
  sigma << kPrior.pose_sigma, kPrior.twist_sigma, kPrior.bias_sigma;
  const Eigen::MatrixXd expected = sigma.cwiseAbs2().asDiagonal();
  EXPECT_EQ(distance(state.covariance(), expected), 0.0);
}

TEST(InvariantState, PropagatesTheErrorAsTheExactDynamicsDo) {
  Random random(1);
  for (int run = 0; run < 5; ++run) {
    State state = busyState(random);
    const Mean before = meanOf(state);
    const Eigen::MatrixXd P = state.covariance();
    const double dt = random.uniform(0.02, 0.3);
    const Eigen::MatrixXd F = derivative(
        [&](const Eigen::VectorXd& error) {
          return errorOf(moved(truthAt(before, error), dt), moved(before, dt));
        },
        state.size());
    state.propagate(dt, kNoNoise);
    EXPECT_LT(distance(state.pose().matrix(), moved(before, dt).pose.matrix()), 1e-12);
    EXPECT_LT(relativeDistance(state.covariance(), F * P * F.transpose()), 1e-8);
    EXPECT_LT(distance(F * gauge(state), gauge(state)), 1e-8);
    expectCovariance(state);
  }
}

TEST(InvariantState, AddsTheSameNoiseInOneStepAsInTen) {
  // At rest the map from twist to pose is constant, and both are exact.
  State one(kPrior);
  one.addLandmark(1, {5.0, 2.0, 1.0}, 0.1 * Eigen::Matrix3d::Identity());
  State ten = one;
  one.propagate(1.0, kNoise);
  for (int i = 0; i < 10; ++i) ten.propagate(0.1, kNoise);
  EXPECT_LT(distance(one.covariance(), ten.covariance()), 1e-13);
  const Vector6d Q = kNoise.twist_density.cwiseAbs2();
  const Vector6d prior = kPrior.twist_sigma.cwiseAbs2();
  const Eigen::MatrixXd P = one.covariance();
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(P(kTwist + i, kTwist + i), prior[i] + Q[i], 1e-13);
    EXPECT_NEAR(P(i, i), 0.01 + prior[i] + Q[i] / 3.0, 1e-13);
    EXPECT_NEAR(P(i, kTwist + i), prior[i] + Q[i] / 2.0, 1e-13);
    EXPECT_NEAR(P(kBias + i, kBias + i), 0.0004 + std::pow(kNoise.bias_density[i], 2), 1e-13);
  }
}

TEST(InvariantState, NoiseDoesNotDependOnTheStepToFirstOrder) {
  Random random(2);
  const State start = busyState(random);
  const auto difference = [&](double dt) {
    // The noise alone: what it adds to the propagation without.
    const auto added = [&](int steps) {
      State with = start, without = start;
      for (int i = 0; i < steps; ++i) {
        with.propagate(dt / steps, kNoise);
        without.propagate(dt / steps, kNoNoise);
      }
      return Eigen::MatrixXd(with.covariance() - without.covariance());
    };
    const Eigen::MatrixXd one = added(1), ten = added(10);
    // Block by block, since they are of different orders in dt.
    return Eigen::Vector3d(
        relativeDistance(one.block<6, 6>(0, 0), ten.block<6, 6>(0, 0)),
        relativeDistance(one.block<6, 6>(0, kTwist), ten.block<6, 6>(0, kTwist)),
        relativeDistance(one.block<6, 6>(kTwist, kTwist), ten.block<6, 6>(kTwist, kTwist)));
  };
  const Eigen::Vector3d coarse = difference(0.02), fine = difference(0.01);
  EXPECT_LT(coarse.maxCoeff(), 0.05);
  for (int i = 0; i < 3; ++i) EXPECT_LE(fine[i], 0.6 * coarse[i] + 1e-9);
}

TEST(InvariantState, CorrectsAsTheTextbookDoes) {
  Random random(3);
  for (const Eigen::Index axis : {0, 3}) {
    State state = busyState(random);
    const Mean before = meanOf(state);
    const Eigen::MatrixXd P = state.covariance();
    const Eigen::MatrixXd H = twistRows(state, axis);
    const Eigen::Matrix3d R = 0.01 * random.covariance<3>();
    const Eigen::Vector3d innovation = 0.01 * random.vector<3>(-1.0, 1.0);
    const Update update = updateOf(state, H, R);
    const auto nis = state.correct(update.HP, update.S, innovation);
    ASSERT_TRUE(nis);
    EXPECT_NEAR(*nis, innovation.dot(update.S.inverse() * innovation), 1e-12);

    const Eigen::MatrixXd K = P * H.transpose() * update.S.inverse();
    const Eigen::MatrixXd I_KH = Eigen::MatrixXd::Identity(P.rows(), P.cols()) - K * H;
    const Eigen::MatrixXd expected = I_KH * P * I_KH.transpose() + K * R * K.transpose();
    EXPECT_LT(relativeDistance(state.covariance(), expected), 1e-11);
    expectCovariance(state);

    const Eigen::VectorXd error = K * innovation;
    EXPECT_LT(distance(state.twist(), before.twist + error.segment<6>(kTwist)), 1e-12);
    EXPECT_LT(distance(state.bias(), before.bias + error.segment<6>(kBias)), 1e-12);
  }
}

TEST(InvariantState, RetractionIsTheErrorsToFirstOrder) {
  Random random(4);
  const State start = busyState(random);
  const StereoRig rig = exampleRig();
  for (const SE3* camera : {static_cast<const SE3*>(nullptr), &rig.cam_T_imu}) {
    for (const double size : {1e-2, 1e-3}) {
      State state = start;
      const Eigen::MatrixXd H = 0.3 * randomMatrix(random, 6, state.size());
      const Update update = updateOf(state, H, Matrix6d::Identity());
      const Vector6d innovation = size * random.vector<6>(-1.0, 1.0);
      const Eigen::VectorXd error = update.HP.transpose() * update.S.inverse() * innovation;
      ASSERT_TRUE(state.correct(update.HP, update.S, innovation, camera));
      const Eigen::VectorXd made = errorOf(meanOf(state), meanOf(start));
      EXPECT_LT(distance(made, error), 20.0 * error.squaredNorm());
      EXPECT_TRUE(so3::isRotation(state.pose().rotation(), 1e-12));
    }
  }
}

TEST(InvariantState, RefusesAnUpdateThatIsNoneAndStaysAsItWas) {
  Random random(5);
  const State start = busyState(random);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Update good = updateOf(start, twistRows(start, 0), Eigen::Matrix3d::Identity());
  const Eigen::Vector3d innovation(0.1, 0.2, 0.3);
  const auto expectRefused = [&](const Eigen::MatrixXd& HP, const Eigen::MatrixXd& S,
                                 const Eigen::VectorXd& y) {
    State state = start;
    EXPECT_FALSE(state.correct(HP, S, y));
    EXPECT_EQ(distance(state.covariance(), start.covariance()), 0.0);
    EXPECT_EQ(distance(state.pose().matrix(), start.pose().matrix()), 0.0);
    EXPECT_EQ(distance(state.twist(), start.twist()), 0.0);
  };
  expectRefused(good.HP, -good.S, innovation);
  expectRefused(good.HP, nan * good.S, innovation);
  expectRefused(good.HP, good.S, nan * innovation);
  expectRefused(nan * good.HP, good.S, innovation);
}

TEST(InvariantState, AddsALandmarkThatMovesWithThePose) {
  Random random(6);
  State state = busyState(random, 2);
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::Matrix3d noise = random.covariance<3>();
  state.addLandmark(99, {1.0, 2.0, 3.0}, noise);
  // The new state is [I; (I 0 ... 0)] times the old one plus noise.
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(state.size(), P.cols());
  A.topRows(P.rows()).setIdentity();
  A.bottomRows<3>().leftCols<3>().setIdentity();
  Eigen::MatrixXd expected = A * P * A.transpose();
  expected.bottomRightCorner<3, 3>() += noise;
  EXPECT_LT(distance(state.covariance(), expected), 1e-14);
  EXPECT_EQ(state.landmarks().back().id, 99u);
  EXPECT_EQ(state.landmarks().back().observations, 1u);
  state.countObservation(2);
  EXPECT_EQ(state.landmarks().back().observations, 2u);
}

TEST(InvariantState, RemovingALandmarkLeavesTheMarginal) {
  Random random(7);
  for (std::size_t gone = 0; gone < 4; ++gone) {
    State state = busyState(random, 4);
    const State before = state;
    state.removeLandmark(gone);
    ASSERT_EQ(state.landmarks().size(), 3u);
    std::vector<Eigen::Index> from;
    for (Eigen::Index i = 0; i < kLandmarks; ++i) from.push_back(i);
    for (const Landmark& l : state.landmarks()) {
      const auto old = std::find_if(before.landmarks().begin(), before.landmarks().end(),
                                    [&](const Landmark& other) { return other.id == l.id; });
      ASSERT_NE(old, before.landmarks().end());
      EXPECT_EQ(distance(old->position, l.position), 0.0);
      const auto index = static_cast<std::size_t>(old - before.landmarks().begin());
      EXPECT_NE(index, gone);
      for (Eigen::Index k = 0; k < 3; ++k) from.push_back(State::offsetOf(index) + k);
    }
    const Eigen::MatrixXd P = before.covariance(), Q = state.covariance();
    for (Eigen::Index i = 0; i < Q.rows(); ++i) {
      for (Eigen::Index j = 0; j < Q.cols(); ++j) {
        EXPECT_NEAR(Q(i, j), P(from[static_cast<std::size_t>(i)], from[static_cast<std::size_t>(j)]), 1e-13);
      }
    }
  }
}

TEST(InvariantState, GrowsBeyondItsFirstCapacityAndKeepsWhatItKnows) {
  Random random(8);
  State state = busyState(random, 1);
  const Eigen::MatrixXd P = state.covariance();
  for (FeatureId id = 100; id < 500; ++id) {
    state.addLandmark(id, Eigen::Vector3d::Constant(static_cast<double>(id)), Eigen::Matrix3d::Identity());
  }
  ASSERT_EQ(state.size(), kLandmarks + 3 * 401);
  EXPECT_EQ(distance(state.covariance().topLeftCorner(P.rows(), P.cols()), P), 0.0);
  EXPECT_TRUE(state.covariance().allFinite());
  const Eigen::MatrixXd grown = state.covariance();
  EXPECT_LT(distance(grown, grown.transpose()), 1e-15);
  while (state.landmarks().size() > 1) state.removeLandmark(1);
  EXPECT_EQ(distance(state.covariance(), P), 0.0);
}

TEST(InvariantState, ForgetsTheTwist) {
  Random random(9);
  for (const Eigen::Index row : {kTwist, kTwist + 3}) {
    State state = busyState(random);
    Eigen::MatrixXd expected = state.covariance();
    expected.middleRows<3>(row).setZero();
    expected.middleCols<3>(row).setZero();
    const Eigen::Vector3d sigma(1.0, 2.0, 3.0);
    expected.diagonal().segment<3>(row) = sigma.cwiseAbs2();
    state.forget(row, sigma);
    EXPECT_EQ(distance(state.covariance(), expected), 0.0);
  }
}

TEST(InvariantState, ReportsCovariancesAlongTheWorldAxes) {
  Random random(10);
  const State state = busyState(random);
  const Mean estimate = meanOf(state);
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::MatrixXd pose = derivative(
      [&](const Eigen::VectorXd& error) {
        const SE3 truth = truthAt(estimate, error).pose;
        Eigen::VectorXd d(6);
        d << truth.translation() - estimate.pose.translation(),
            so3::Log(truth.rotation() * estimate.pose.rotation().transpose());
        return d;
      },
      state.size());
  EXPECT_LT(relativeDistance(state.poseCovariance(), pose * P * pose.transpose()), 1e-8);
  for (std::size_t i = 0; i < estimate.landmarks.size(); ++i) {
    const Eigen::MatrixXd J = derivative(
        [&](const Eigen::VectorXd& error) -> Eigen::VectorXd {
          return truthAt(estimate, error).landmarks[i];
        },
        state.size());
    EXPECT_LT(relativeDistance(state.landmarkCovariance(i), J * P * J.transpose()), 1e-8);
  }
}

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

TEST(InvariantStereo, StacksHPAndS) {
  Random random(12);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  const State state = busyState(random);
  std::vector<Observation> observations = observationsOf(model, state, 1.0, random);
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
  const Eigen::MatrixXd HP = model.crossCovariance(state, observations);
  EXPECT_LT(relativeDistance(HP, expected.HP), 1e-12);
  EXPECT_LT(relativeDistance(model.innovationCovariance(observations, HP), expected.S), 1e-12);
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
  const std::vector<Observation> one{*seen};
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
    const Eigen::MatrixXd HP = model.crossCovariance(state, observations);
    ASSERT_TRUE(state.correct(HP, model.innovationCovariance(observations, HP),
                              stackInnovations(observations), &model.rig().cam_T_imu));
    EXPECT_LT(relativeDistance(information(state, gauge(state)), before), 1e-6) << frame;
    state.propagate(0.02, kNoNoise);
    EXPECT_LT(relativeDistance(information(state, gauge(state)), before), 1e-6) << frame;
    expectCovariance(state);
  }
}

TEST(InvariantState, MovesALandmarkWithItsCovarianceInInverseDepth) {
  Random random(16);
  const StereoModel model(exampleRig(), 0.7, 0.5);
  for (int run = 0; run < 20; ++run) {
    const State start = busyState(random, 4);
    const auto observations = observationsOf(model, start, 3.0, random);
    const Eigen::MatrixXd HP = model.crossCovariance(start, observations);
    const Eigen::MatrixXd S = model.innovationCovariance(observations, HP);
    State still = start, with = start;
    still.correct(HP, S, Eigen::VectorXd::Zero(S.rows()), &model.rig().cam_T_imu);
    with.correct(HP, S, stackInnovations(observations), &model.rig().cam_T_imu);
    expectCovariance(with);
    // The covariance of all, with (x/z, y/z, 1/z) in place of the landmarks' errors, must not have changed.
    const SE3 cam_T_world = model.rig().cam_T_imu * with.pose().inverse();
    const auto inInverseDepth = [&](const State& state) {
      Eigen::MatrixXd A = Eigen::MatrixXd::Identity(state.size(), state.size());
      for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
        const Eigen::Matrix3d J =
            InverseDepth::jacobian(cam_T_world * state.landmarks()[i].position) * cam_T_world.rotation();
        A.block<3, 3>(State::offsetOf(i), State::offsetOf(i)) = J;
        A.block<3, 3>(State::offsetOf(i), kPosition) = -J;
      }
      return Eigen::MatrixXd(A * state.covariance() * A.transpose());
    };
    const Eigen::MatrixXd expected = inInverseDepth(still), actual = inInverseDepth(with);
    EXPECT_GT(distance(with.landmarks()[0].position, still.landmarks()[0].position), 1e-3);
    EXPECT_LT(distance(actual, expected), 1e-12);
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

/// A car at `speed` whose pair sees lengths 1 / (1 + error) of what they are; factor after each sample.
std::vector<double> factors(ScaleMonitor& monitor, double speed, double error, double sigma, int samples,
                            unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  const Eigen::Matrix3d noise = sigma * sigma * Eigen::Matrix3d::Identity();
  std::vector<double> result;
  for (int i = 0; i < samples; ++i) {
    const Eigen::Vector3d truth(speed, 0.1, 0.0);
    const Eigen::Vector3d measured = truth + Eigen::Vector3d(normal(engine), normal(engine), normal(engine));
    const Eigen::Vector3d seen = truth / (1.0 + error) * monitor.factor();
    monitor.compare(measured, noise, seen, 1e-6 * Eigen::Matrix3d::Identity());
    result.push_back(monitor.factor());
  }
  return result;
}

TEST(ScaleMonitor, LeavesAGoodPairAlone) {
  int touched = 0;
  for (unsigned seed = 0; seed < 100; ++seed) {
    ScaleMonitor monitor(0.02, 4.0);
    const auto all = factors(monitor, 8.0, 0.0, 0.5, 1000, seed);
    if (std::any_of(all.begin(), all.end(), [](double factor) { return factor != 1.0; })) ++touched;
  }
  EXPECT_LE(touched, 2);
}

TEST(ScaleMonitor, FindsAnErrorOfScale) {
  for (const double error : {0.03, -0.03}) {
    for (unsigned seed = 0; seed < 20; ++seed) {
      ScaleMonitor monitor(0.02, 4.0);
      EXPECT_NEAR(factors(monitor, 8.0, error, 0.1, 50, seed).back(), 1.0 + error, 0.01);
      EXPECT_NEAR(factors(monitor, 8.0, error, 0.1, 5000, seed + 100).back(), 1.0 + error, 0.002);
    }
  }
}

TEST(ScaleMonitor, CannotRunAway) {
  for (const double error : {2.0, -0.7}) {
    ScaleMonitor monitor(0.02, 4.0);
    for (const double factor : factors(monitor, 8.0, error, 0.1, 2000, 1)) {
      EXPECT_LE(std::abs(factor - 1.0), 5.0 * 0.02 + 1e-12);
    }
    EXPECT_NEAR(monitor.factor(), error > 0.0 ? 1.1 : 0.9, 1e-9);
  }
}

TEST(ScaleMonitor, IgnoresSlowSpeedsAndAnExactScale) {
  ScaleMonitor slow(0.02, 4.0);
  EXPECT_EQ(factors(slow, 1.9, 0.05, 0.01, 5000, 1).back(), 1.0);
  ScaleMonitor exact(0.0, 4.0);
  EXPECT_EQ(factors(exact, 8.0, 0.05, 0.01, 5000, 1).back(), 1.0);
}

TEST(ScaleMonitor, IsNotPoisonedByAnEstimateThatIsNotFinite) {
  ScaleMonitor monitor(0.02, 4.0);
  const Eigen::Vector3d nan = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  monitor.compare({8.0, 0.0, 0.0}, Eigen::Matrix3d::Identity(), nan, Eigen::Matrix3d::Identity());
  EXPECT_NEAR(factors(monitor, 8.0, 0.03, 0.1, 200, 1).back(), 1.03, 0.01);
}

} // namespace
} // namespace vi_ekf_slam::invariant

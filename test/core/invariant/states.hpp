#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "../covariances.hpp"
#include "../numeric.hpp"
#include "../street.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/invariant/stereo_update.hpp"

/// States of the right-invariant filter to be tested with, and its error written as its definition stands.
namespace vi_ekf_slam::test {

using namespace invariant;

inline const ProcessNoise kNoNoise{Vector6d::Zero(), Vector6d::Zero()};
inline const ProcessNoise kNoise{(Vector6d() << 0.5, 0.1, 0.2, 0.05, 0.06, 0.07).finished(),
                                 (Vector6d() << 0.01, 0.02, 0.03, 0.004, 0.005, 0.006).finished()};
inline const Prior kPrior{Vector6d::Constant(0.1), Vector6d::Constant(0.3), Vector6d::Constant(0.02)};

inline Eigen::MatrixXd randomMatrix(Random& random, Eigen::Index rows, Eigen::Index cols) {
  Eigen::MatrixXd A(rows, cols);
  for (Eigen::Index i = 0; i < A.size(); ++i) A(i) = random.uniform(-1.0, 1.0);
  return A;
}

/// The update of a measurement H x with the given noise, as a caller of State puts it.
struct Update {
  Eigen::MatrixXd PHt, S;
};

inline Update updateOf(const State& state, const Eigen::MatrixXd& H, const Eigen::MatrixXd& noise) {
  const Eigen::MatrixXd PHt = state.covariance() * H.transpose();
  return {PHt, H * PHt + noise};
}

inline Eigen::MatrixXd twistRows(const State& state, Eigen::Index axis) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, state.size());
  H.middleCols<3>(kTwist + axis).setIdentity();
  H.middleCols<3>(kBias + axis).setIdentity();
  return H;
}

/// Far from the origin, moving and turning, `landmarks` of them in view, everything correlated.
inline State busyState(Random& random, std::size_t landmarks = 3) {
  State state(kPrior);
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(6, state.size());
  H.middleCols<6>(kTwist).setIdentity();
  const Update start = updateOf(state, H, 1e-6 * Matrix6d::Identity());
  const Vector6d twist = (Vector6d() << 8.0, 0.3, -0.2, 0.05, -0.1, 0.4).finished();
  state.apply(Correction(start.PHt, start.S, twist));
  for (int i = 0; i < 20; ++i) state.propagate(0.1, kNoise);
  const SE3 world_T_cam = state.pose() * exampleRig().cam_T_imu.inverse();
  for (std::size_t i = 0; i < landmarks; ++i) {
    const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0), random.uniform(5.0, 20.0));
    state.addLandmark(10 + i, world_T_cam * q, 0.1 * random.covariance<3>());
  }
  const Eigen::MatrixXd mix = 0.3 * randomMatrix(random, 5, state.size());
  const Update update = updateOf(state, mix, 0.1 * Eigen::MatrixXd::Identity(5, 5));
  state.apply(Correction(update.PHt, update.S, Eigen::VectorXd::Zero(5)));
  state.propagate(0.1, kNoise);
  return state;
}

/// A truth or a mean: what State estimates.
struct Mean {
  SE3 pose;
  Vector6d twist, bias;
  std::vector<Eigen::Vector3d> landmarks;
};

inline Mean meanOf(const State& state) {
  Mean mean{state.pose(), state.twist(), state.bias(), {}};
  for (const Landmark& l : state.landmarks()) mean.landmarks.push_back(l.position);
  return mean;
}

/// The truth that lies `error` from `estimate`, by the definition of the error.
inline Mean truthAt(const Mean& estimate, const Eigen::VectorXd& error) {
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

inline Eigen::VectorXd errorOf(const Mean& truth, const Mean& estimate) {
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
inline Eigen::MatrixXd derivative(const F& f, Eigen::Index size) {
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

inline Mean moved(Mean mean, double dt) {
  mean.pose = mean.pose * SE3::Exp(dt * mean.twist);
  return mean;
}

/// Directions of the error that move the whole world: three shifts, three rotations about the origin.
inline Eigen::MatrixXd gauge(const State& state) {
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(state.size(), 6);
  N.block<3, 3>(kPosition, 0).setIdentity();
  N.block<3, 3>(kRotation, 3).setIdentity();
  for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
    N.block<3, 3>(State::offsetOf(i), 0).setIdentity();
  }
  return N;
}

/// What is known about the direction `N` when nothing else is free.
inline Eigen::MatrixXd information(const State& state, const Eigen::MatrixXd& N) {
  const Eigen::MatrixXd P = state.covariance();
  return N.transpose() * inverseOf(P) * N;
}

inline void expectCovariance(const State& state) {
  const Eigen::MatrixXd P = state.covariance();
  EXPECT_LE(distance(P, P.transpose()), 1e-13 * P.cwiseAbs().maxCoeff());
  EXPECT_TRUE(isPositive(P, 1e-13));
}

/// All landmarks of `state` seen `offset` px from where they are expected.
inline PooledVector<Observation> observationsOf(const StereoModel& model, const State& state, double offset,
                                                Random& random) {
  PooledVector<Observation> observations;
  const SE3 cam_T_world = model.rig().cam_T_imu * state.pose().inverse();
  for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
    const StereoPixels expected = model.rig().camera.project(cam_T_world * state.landmarks()[i].position);
    const auto seen = model.observe(state, i, expected + offset * random.vector<4>(-1.0, 1.0));
    EXPECT_TRUE(seen);
    if (seen) observations.push_back(*seen);
  }
  return observations;
}

/// A state as the filter has it: the landmarks are known from the pixels of the frames before.
inline State seenState(const StereoModel& model, unsigned seed, std::size_t landmarks) {
  Random random(seed);
  State state({Vector6d::Constant(1e-3), (Vector6d() << 0.1, 0.1, 0.1, 0.01, 0.01, 0.01).finished(),
               Vector6d::Constant(1e-3)});
  for (std::size_t i = 0; i < landmarks; ++i) {
    const Eigen::Vector3d q(random.uniform(-4.0, 4.0), random.uniform(-1.0, 2.0), random.uniform(6.0, 12.0));
    const auto sighting = model.triangulate(state, model.rig().camera.project(q), 100.0);
    state.addLandmark(i, sighting->position, sighting->covariance);
  }
  state.propagate(0.1, {Vector6d::Constant(0.05), Vector6d::Zero()});
  return state;
}

/// `frame` feature by feature, against the landmark of the same index.
inline PooledVector<Observation> observe(const StereoModel& model, const State& state,
                                         const StereoFrame& frame) {
  PooledVector<Observation> observations;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    auto seen = model.observe(state, i, frame.features[i].pixels);
    if (!seen) continue;
    seen->feature = i;
    observations.push_back(*seen);
  }
  return observations;
}

} // namespace vi_ekf_slam::test

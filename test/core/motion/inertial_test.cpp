// The inertial model: its mean against numeric integration, its transition against numeric derivatives, its
// noise against what white noise and random walks add up to.

#include <cmath>

#include "inertial_core.hpp"
#include "vi_ekf_slam/core/motion/initial_state.hpp"

namespace vi_ekf_slam::test {
namespace {

const Eigen::Vector3d kDown(0.0, 0.0, -kGravity);

struct Body {
  Eigen::Matrix3d R;
  Eigen::Vector3d v, p;
};

/// R' = R [w]x, v' = R a + g, p' = v by the classic Runge-Kutta method.
template <typename Rate, typename Force>
Body integrate(Body body, const Rate& w, const Force& a, double seconds, int steps) {
  const auto slope = [&](const Body& b, double t) {
    return Body{b.R * so3::hat(w(t)), b.R * a(t) + kDown, b.v};
  };
  const auto plus = [](const Body& b, double h, const Body& s) {
    return Body{b.R + h * s.R, b.v + h * s.v, b.p + h * s.p};
  };
  const double h = seconds / steps;
  for (int i = 0; i < steps; ++i) {
    const double t = h * i;
    const Body k1 = slope(body, t), k2 = slope(plus(body, 0.5 * h, k1), t + 0.5 * h),
               k3 = slope(plus(body, 0.5 * h, k2), t + 0.5 * h), k4 = slope(plus(body, h, k3), t + h);
    body = plus(plus(plus(plus(body, h / 6.0, k1), h / 3.0, k2), h / 3.0, k3), h / 6.0, k4);
  }
  return body;
}

TEST(InertialModel, MeanIsExactForASteadyRateAndForce) {
  Random random(1);
  for (int run = 0; run < 10; ++run) {
    InertialScene scene = randomInertial(random);
    const Eigen::Vector3d w = random.vector<3>(-2.0, 2.0), a = random.vector<3>(-15.0, 15.0);
    const Eigen::Vector3d bg = scene.filter.variables().mean(handleOf(scene.filter, Inertial::kGyroBias)),
                          ba = scene.filter.variables().mean(
                              handleOf(scene.filter, Inertial::kAccelerometerBias));
    const Body begin{scene.filter.pose().rotation(), scene.velocity(), scene.filter.pose().translation()};
    const double dt = 0.01 * (run + 1);
    const Body expected = integrate(
        begin, [&](double) { return w; }, [&](double) { return a; }, dt, 200);
    scene.propagate(steadyImu(withoutImuNoise(), w + bg, a + ba, dt), 0.0, dt);
    EXPECT_LT(distance(scene.filter.pose().rotation(), expected.R), 1e-12);
    EXPECT_LT(distance(scene.velocity(), expected.v), 1e-12);
    EXPECT_LT(distance(scene.filter.pose().translation(), expected.p), 1e-12);
    // In a hundred steps as in one.
    InertialScene other = scene;
    const double whole = 0.1;
    const ImuTrack imu = steadyImu(withoutImuNoise(), w + bg, a + ba, whole);
    other.propagate(imu, 0.0, whole, 100);
    scene.propagate(imu, 0.0, whole);
    EXPECT_LT(distance(other.filter.pose().matrix(), scene.filter.pose().matrix()), 1e-12);
    EXPECT_LT(distance(other.velocity(), scene.velocity()), 1e-12);
  }
}

// A turn through more than a circle in one step: closed forms, not series.
TEST(InertialModel, MeanIsExactOverALongStep) {
  const Eigen::Vector3d w(3.0, -5.0, 4.0), a(2.0, 9.0, -4.0);
  InertialScene scene;
  const Body expected = integrate(
      {Eigen::Matrix3d::Identity(), {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}}, [&](double) { return w; },
      [&](double) { return a; }, 1.0, 20000);
  scene.propagate(steadyImu(withoutImuNoise(), w, a, 1.0), 0.0, 1.0);
  EXPECT_LT(distance(scene.filter.pose().rotation(), expected.R), 1e-12);
  EXPECT_LT(distance(scene.velocity(), expected.v), 1e-12);
  EXPECT_LT(distance(scene.filter.pose().translation(), expected.p), 1e-12);
}

TEST(InertialModel, MeanOfASmoothMotionConvergesWithTheCubeOfTheInterval) {
  const auto w = [](double t) {
    return Eigen::Vector3d(0.8 * std::sin(2.0 * t), 0.5 * std::cos(3.0 * t), 0.3 + 0.4 * std::sin(t));
  };
  const auto a = [](double t) {
    return Eigen::Vector3d(2.0 * std::cos(2.5 * t), std::sin(4.0 * t), 9.81 + std::sin(3.0 * t));
  };
  const Body expected =
      integrate({Eigen::Matrix3d::Identity(), {1.0, 0.0, 0.0}, {0.0, 0.0, 0.0}}, w, a, 2.0, 4000);
  Eigen::Vector3d before;
  for (const int rate : {50, 100, 200, 400}) {
    InertialScene scene;
    scene.filter.setMean(handleOf(scene.filter, Inertial::kVelocity), Eigen::Vector3d(1.0, 0.0, 0.0));
    ImuTrack imu({}, true);
    imu.reach(imuSample(-1.0 / rate, w(-1.0 / rate), a(-1.0 / rate)));
    imu.reach(imuSample(0.0, w(0.0), a(0.0)));
    for (int i = 0; i < 2 * rate; ++i) {
      const double now = static_cast<double>(i) / rate, next = static_cast<double>(i + 1) / rate;
      imu.expect(imuSample(next, w(next), a(next)));
      scene.propagate(imu, now, next);
      imu.reach(imuSample(next, w(next), a(next)));
    }
    const Eigen::Vector3d error(so3::Log(scene.filter.pose().rotation() * expected.R.transpose()).norm(),
                                distance(scene.velocity(), expected.v),
                                distance(scene.filter.pose().translation(), expected.p));
    for (int i = 0; rate > 50 && i < 3; ++i) {
      EXPECT_GT(before[i] / error[i], 7.0) << rate << " " << i;
    }
    before = error;
  }
  EXPECT_LT(before.maxCoeff(), 1e-6);
}

/// How the filter's errors change from 0 s to `dt`: by what a copy of them then has in common with them.
Eigen::MatrixXd transitionOf(InertialScene scene, const ImuTrack& imu, double dt) {
  const Eigen::Index n = scene.filter.coreRows();
  const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(n, n);
  scene.filter.setCoreCovariance(I);
  scene.filter.augment(Chart::kVector, Eigen::VectorXd::Zero(n), 1e-9 * I, {0, I});
  scene.propagate(imu, 0.0, dt);
  scene.filter.settle();
  return scene.filter.covariance().block(0, n, n, n);
}

/// The same by the definition of the errors and the mean alone.
Eigen::MatrixXd numericTransition(const InertialScene& scene, const ImuTrack& imu, double dt) {
  const Variables variables = scene.filter.variables();
  const State before = stateOf(scene.filter);
  const auto moved = [&](const State& from) {
    InertialScene other = scene;
    other.filter.begin(from.pose);
    for (const Handle handle : variables.handles()) {
      if (variables.chartOf(handle) != Chart::kPose)
        other.filter.setMean(handle, from.x.segment(variables.rowOf(handle), variables.sizeOf(handle)));
    }
    other.propagate(imu, 0.0, dt);
    return stateOf(other.filter);
  };
  const State after = moved(before);
  return derivative(
      [&](const Eigen::VectorXd& error) {
        return errorOf(variables, moved(truthAt(variables, before, error)), after);
      },
      variables.rows());
}

TEST(InertialModel, TransitionIsTheDerivativeOfTheMean) {
  Random random(2);
  for (int run = 0; run < 20; ++run) {
    const InertialScene scene = randomInertial(random);
    ASSERT_EQ(scene.filter.rows(), 15);
    const Eigen::Index bg = scene.filter.rowOf(handleOf(scene.filter, Inertial::kGyroBias));
    const Eigen::Vector3d w = random.vector<3>(-1.5, 1.5), a = random.vector<3>(-15.0, 15.0);
    double left_before = 0.0;
    for (const double dt : {0.04, 0.02, 0.01}) {
      const ImuTrack imu = steadyImu(withoutImuNoise(), w, a, dt);
      const Eigen::MatrixXd F = transitionOf(scene, imu, dt), expected = numericTransition(scene, imu, dt);
      for (Eigen::Index row = 0; row < 15; row += 3) {
        for (Eigen::Index column = 0; column < 15; column += 3) {
          const Eigen::MatrixXd block = expected.block<3, 3>(row, column);
          const double scale = std::max(block.cwiseAbs().maxCoeff(), 1e-6);
          // Velocity and position by the gyro's bias: to first order in the turn.
          const bool first_order = column == bg && (row == 0 || row == 6);
          EXPECT_LT(distance(F.block<3, 3>(row, column), block), (first_order ? 4e-3 : 1e-6) * scale)
              << row << " " << column << " " << dt;
        }
      }
      const double left = distance(F.block<3, 3>(6, bg), expected.block<3, 3>(6, bg));
      // What is left out is two orders of the interval smaller than the block.
      EXPECT_TRUE(left_before == 0.0 || left_before / left > 12.0) << dt << ": " << left_before / left;
      left_before = left;
    }
  }
}

// What is shown of a force u is (I - M)^-1 (u + b_a).
TEST(InertialModel, ScaleAndAlignmentOfTheAccelerometerAreTakenOut) {
  Random random(7);
  for (int run = 0; run < 10; ++run) {
    const InertialScene scene = randomInertial(random, withoutImuNoise(), true);
    ASSERT_EQ(scene.filter.rows(), 24);
    InertialScene ideal = randomInertial(random);
    ideal.filter.begin(scene.filter.pose());
    ideal.filter.setMean(handleOf(ideal.filter, Inertial::kVelocity), scene.velocity());
    const auto mean = [](const InertialScene& of, Handle handle) -> Eigen::Vector3d {
      return of.filter.variables().mean(handle);
    };
    const Eigen::Vector3d w = random.vector<3>(-1.5, 1.5), a = random.vector<3>(-15.0, 15.0);
    const Eigen::VectorXd m =
        scene.filter.variables().mean(*scene.filter.variables().find(Inertial::kAccelerometerScale));
    const Eigen::Vector3d shown =
        (Eigen::Matrix3d::Identity() - Eigen::Map<const Eigen::Matrix3d>(m.data())).inverse() *
        (a + mean(scene, handleOf(scene.filter, Inertial::kAccelerometerBias)));
    const double dt = 0.02;
    const auto imuOf = [&](const InertialScene& of, const Eigen::Vector3d& acceleration) {
      return steadyImu(withoutImuNoise(), w + mean(of, handleOf(of.filter, Inertial::kGyroBias)),
                       acceleration, dt);
    };
    InertialScene moved = scene;
    moved.propagate(imuOf(scene, shown), 0.0, dt);
    ideal.propagate(imuOf(ideal, a + mean(ideal, handleOf(ideal.filter, Inertial::kAccelerometerBias))), 0.0,
                    dt);
    EXPECT_LT(distance(moved.filter.pose().matrix(), ideal.filter.pose().matrix()), 1e-12);
    EXPECT_LT(distance(moved.velocity(), ideal.velocity()), 1e-12);
    const ImuTrack imu = imuOf(scene, shown);
    const Eigen::MatrixXd F = transitionOf(scene, imu, dt), expected = numericTransition(scene, imu, dt);
    EXPECT_LT(distance(F.middleCols(12, 12), expected.middleCols(12, 12)), 1e-6);
  }
}

TEST(InertialModel, NoiseIsPositiveAndTheSumOverTheSteps) {
  Random random(3);
  Inertial::Options options;
  options.noise = {0.01, 0.1, 1e-3, 1e-2};
  options.noise_given = true;
  for (int run = 0; run < 10; ++run) {
    const InertialScene start = randomInertial(random, options);
    const ImuTrack imu = steadyImu(options, random.vector<3>(-1.5, 1.5), random.vector<3>(-15.0, 15.0), 0.02);
    const auto covarianceAfter = [&](int steps) {
      InertialScene scene = start;
      scene.filter.setCoreCovariance(Eigen::MatrixXd::Zero(15, 15));
      scene.propagate(imu, 0.0, 0.02, steps);
      return Eigen::MatrixXd(scene.filter.covariance());
    };
    const Eigen::MatrixXd one = covarianceAfter(1), two = covarianceAfter(2), many = covarianceAfter(64);
    EXPECT_LE(distance(one, one.transpose()), 1e-15);
    EXPECT_TRUE(isPositive(one, 1e-12));
    EXPECT_TRUE(isJointlyPositive(many, 1e-9));
    // What noise within a step makes of the position is of the third order of the step: a quarter of it in
    // the place of a third. It counts beside one step, and not beside many.
    for (Eigen::Index row = 3; row < 15; row += 3)
      EXPECT_LT(relativeDistance(two.block<3, 3>(row, row), many.block<3, 3>(row, row)), 0.02) << row;
    EXPECT_LT(relativeDistance(one.block<3, 3>(0, 0), many.block<3, 3>(0, 0)), 0.3);
    EXPECT_LT(relativeDistance(covarianceAfter(32).topLeftCorner<3, 3>(), many.topLeftCorner<3, 3>()), 1e-2);
  }
}

// At rest and level all of it can be integrated on paper.
TEST(InertialModel, NoiseAtRestIsThatOfThePaperAndPencil) {
  static constexpr double T = 2.0, g = kGravity;
  const auto after = [](const ImuNoise& noise, int steps) {
    Inertial::Options options;
    options.noise = noise;
    options.noise_given = true;
    InertialScene scene(options);
    scene.filter.setCoreCovariance(Eigen::MatrixXd::Zero(15, 15));
    const ImuTrack imu = steadyImu(options, Eigen::Vector3d::Zero(), {0.0, 0.0, g}, 0.1);
    for (int i = 0; i < 20; ++i) scene.propagate(imu, 0.0, 0.1, steps / 20);
    return Eigen::VectorXd(scene.filter.covariance().diagonal());
  };
  const auto expect = [](const Eigen::VectorXd& got, Eigen::Index row, double variance) {
    EXPECT_NEAR(got[row], variance, 0.02 * variance) << row;
  };
  constexpr int kSteps = 400;
  const Eigen::VectorXd gyro = after({0.1, 0.0, 0.0, 0.0}, kSteps);
  for (const Eigen::Index axis : {0, 1}) {
    expect(gyro, 3 + axis, 0.01 * T);
    expect(gyro, 6 + axis, 0.01 * g * g * std::pow(T, 3) / 3.0);
    expect(gyro, axis, 0.01 * g * g * std::pow(T, 5) / 20.0);
  }
  EXPECT_NEAR(gyro[8], 0.0, 1e-12);
  const Eigen::VectorXd force = after({0.0, 0.1, 0.0, 0.0}, kSteps);
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    expect(force, 6 + axis, 0.01 * T);
    expect(force, axis, 0.01 * std::pow(T, 3) / 3.0);
    EXPECT_EQ(force[3 + axis], 0.0);
  }
  const Eigen::VectorXd gyro_walk = after({0.0, 0.0, 0.1, 0.0}, kSteps);
  expect(gyro_walk, 9, 0.01 * T);
  expect(gyro_walk, 5, 0.01 * std::pow(T, 3) / 3.0);
  expect(gyro_walk, 6, 0.01 * g * g * std::pow(T, 5) / 20.0);
  expect(gyro_walk, 0, 0.01 * g * g * std::pow(T, 7) / 252.0);
  const Eigen::VectorXd force_walk = after({0.0, 0.0, 0.0, 0.1}, kSteps);
  expect(force_walk, 14, 0.01 * T);
  expect(force_walk, 8, 0.01 * std::pow(T, 3) / 3.0);
  expect(force_walk, 2, 0.01 * std::pow(T, 5) / 20.0);
}

TEST(InertialModel, BeginsWithAStateWhoseErrorsAreItsOwn) {
  Random random(4);
  const InertialScene scene = randomInertial(random);
  const State estimate = stateOf(scene.filter);
  InitialState state;
  state.world_T_imu = estimate.pose;
  state.velocity = estimate.x.segment<3>(6);
  state.gyro_bias = estimate.x.segment<3>(9);
  state.accelerometer_bias = estimate.x.segment<3>(12);
  state.covariance = randomCovariance(random, 15, 0.01);
  InertialScene begun;
  ASSERT_TRUE(begun.motion.begin(begun.filter, state));
  EXPECT_LT(distance(stateOf(begun.filter).x, estimate.x), 1e-15);
  EXPECT_EQ(distance(begun.filter.pose().matrix(), estimate.pose.matrix()), 0.0);
  // The error of a velocity that is off by dv while the body is turned by theta.
  const Eigen::MatrixXd J = derivative(
      [&](const Eigen::VectorXd& x) {
        State truth = estimate;
        truth.pose = SE3(so3::Exp(x.segment<3>(3)) * estimate.pose.rotation(),
                         estimate.pose.translation() + x.head<3>());
        truth.x.tail<9>() += x.tail<9>();
        return errorOf(begun.filter.variables(), truth, estimate);
      },
      15);
  EXPECT_LT(relativeDistance(begun.filter.covariance(), J * state.covariance * J.transpose()), 1e-8);
  expectCovariance(begun.filter.covariance());
}

TEST(InertialModel, AVelocitySampleMeasuresTheVelocityAlongTheBodysAxes) {
  Random random(5);
  InertialScene scene = randomInertial(random);
  scene.filter.setCoreCovariance(randomCovariance(random, 15, 0.1));
  const Eigen::Vector3d v = random.vector<3>(-5.0, 5.0);
  VelocitySample sample;
  sample.linear_velocity = v;
  sample.covariance = isotropic(1e-5);
  for (int i = 0; i < 3; ++i) scene.filter.correct(scene.motion.measure(scene.filter, sample));
  const Eigen::Vector3d now = scene.filter.pose().rotation().transpose() * scene.velocity();
  EXPECT_LT(distance(now, v), 1e-4);
  EXPECT_LT(scene.motion.twistCovariance(scene.filter, ImuTrack({}, true)).diagonal().head<3>().maxCoeff(),
            2e-10);
}

} // namespace
} // namespace vi_ekf_slam::test

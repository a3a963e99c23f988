#include <gtest/gtest.h>

#include <cmath>

#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam::simulation {
namespace {

/// Largest element by which two poses differ, m or 1.
double distance(const SE3& a, const SE3& b) { return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff(); }

DriveOptions noiseFree() {
  DriveOptions options;
  options.velocity_sigma = options.gyro_sigma = options.gyro_bias_min = options.gyro_bias_max = 0.0;
  return options;
}

double deadReckoningError(const DriveOptions& options) {
  DeadReckoning dead_reckoning;
  double worst = 0.0;
  for (const DriveStep& step : simulateDrive(options).steps) {
    for (const Measurement& measurement : measurementsOf(step)) {
      if (const auto* gyro = std::get_if<ImuSample>(&measurement)) {
        dead_reckoning.process(*gyro);
      } else if (const auto* velocity = std::get_if<VelocitySample>(&measurement)) {
        dead_reckoning.process(*velocity);
      } else {
        dead_reckoning.advanceTo(step.stamp);
        worst = std::max(worst, distance(dead_reckoning.pose(), step.world_T_imu));
      }
    }
  }
  return worst;
}

TEST(Motion, FirstPoseIsTheIdentity) {
  DriveOptions options;
  EXPECT_EQ(distance(DriveSimulator(options).next()->world_T_imu, SE3()), 0.0);
  options.motion = MotionModel::kProcessModel;
  options.duration = 1.0;
  EXPECT_EQ(distance(DriveSimulator(options).next()->world_T_imu, SE3()), 0.0);
}

TEST(Motion, NoiseFreeSamplesDeadReckonToTheCarsTruth) {
  DriveOptions options = noiseFree();
  options.standing_start = 2.0;
  options.corner_stop = 1.0;
  EXPECT_LT(deadReckoningError(options), 1e-9);
  options.duration = 30.0;
  for (const double frame_rate : {5.0, 10.0, 30.0}) {
    for (const double imu_rate : {10.0, 100.0, 400.0}) {
      options.frame_rate = frame_rate;
      options.imu_rate = imu_rate;
      EXPECT_LT(deadReckoningError(options), 1e-9) << frame_rate << ", " << imu_rate;
    }
  }
}

TEST(Motion, TheCarTakesNoNoticeOfItsCamera) {
  DriveOptions options;
  options.duration = 30.0;
  options.imu_rate = 100.0;
  options.frame_rate = 5.0;
  const Drive slow = simulateDrive(options);
  options.frame_rate = 30.0;
  const Drive fast = simulateDrive(options);
  ASSERT_EQ(fast.steps.size(), 6 * slow.steps.size());
  for (std::size_t k = 0; k < slow.steps.size(); ++k) {
    ASSERT_EQ(slow.steps[k].stamp, fast.steps[6 * k].stamp);
    ASSERT_LT(distance(slow.steps[k].world_T_imu, fast.steps[6 * k].world_T_imu), 1e-9) << k;
  }
}

// Held samples miss what the twist does within a step: the position by sums of q sqrt(dt^3 / 3) a step.
TEST(Motion, ProcessModelMovesWithinItsSteps) {
  DriveOptions options = noiseFree();
  options.motion = MotionModel::kProcessModel;
  options.duration = 30.0;
  const double coarse = deadReckoningError(options);
  EXPECT_GT(coarse, 0.01);
  options.noise_forward = options.noise_lateral = options.noise_vertical = options.noise_rotation = 0.0;
  EXPECT_LT(deadReckoningError(options), 1e-9);
}

/// Covariance of (position along x - speed t, speed gained) after 1 s of pure acceleration noise along x,
/// drawn in `steps` steps.
Eigen::Matrix2d lawOfOneSecond(int steps) {
  DriveOptions options;
  options.motion = MotionModel::kProcessModel;
  options.noise_lateral = options.noise_vertical = options.noise_rotation = 0.0;
  Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
  constexpr int kDraws = 20000;
  for (int draw = 0; draw < kDraws; ++draw) {
    options.seed = static_cast<std::uint64_t>(draw);
    ProcessMotion motion(options);
    for (int i = 0; i < steps; ++i) motion.step(1.0 / steps);
    const double x = motion.world_T_imu().translation().x();
    const Eigen::Vector2d d(x - options.speed, motion.step(1.0)[0] - options.speed);
    sum += d * d.transpose() / kDraws;
  }
  return sum / (options.noise_forward * options.noise_forward);
}

TEST(Motion, ProcessModelHasTheLawOfIntegratedWhiteNoiseWhateverTheStep) {
  Eigen::Matrix2d expected; // integral of (1 - s, 1)^T (1 - s, 1)
  expected << 1.0 / 3.0, 0.5, 0.5, 1.0;
  for (const int steps : {1, 2, 10}) {
    // Largest standard deviation of an entry's mean: sqrt(2 / 20000) = 0.01.
    EXPECT_LT((lawOfOneSecond(steps) - expected).cwiseAbs().maxCoeff(), 0.04) << steps;
  }
}

TEST(Motion, TwoLapsReturnToTheStart) {
  const Drive drive = simulateDrive(DriveOptions());
  const double lap = BlockPath(drive.options.block_length, drive.options.block_width).perimeter();
  double length = 0.0, highest = 0.0;
  for (std::size_t k = 1; k < drive.steps.size(); ++k) {
    const SE3 &a = drive.steps[k - 1].world_T_imu, &b = drive.steps[k].world_T_imu;
    length += (b.translation() - a.translation()).norm();
    highest = std::max(highest, drive.steps[k].true_twist.front().head<3>().norm());
  }
  EXPECT_NEAR(length, 2.0 * lap, 0.01 * lap);
  EXPECT_LT(drive.steps.back().world_T_imu.translation().norm(), 2.0);
  EXPECT_NEAR(highest, drive.options.speed, 0.1);
}

TEST(Motion, StandsStillWhereItIsTold) {
  DriveOptions options;
  options.standing_start = 3.0;
  options.corner_stop = 4.0;
  int at_rest = 0;
  for (const DriveStep& step : simulateDrive(options).steps) {
    const bool rest = step.true_twist.front().isZero(0.0);
    at_rest += rest ? 1 : 0;
    EXPECT_TRUE(rest || step.index >= 30) << step.index;
  }
  EXPECT_NEAR(at_rest, 70, 1);
}

TEST(Motion, ProcessModelIsARandomWalkOfTheGivenDensity) {
  DriveOptions options;
  options.motion = MotionModel::kProcessModel;
  options.duration = 2000.0;
  options.features_max = 1;
  options.features_min = 0;
  const Drive drive = simulateDrive(options);
  Vector6d sum = Vector6d::Zero(), lagged = Vector6d::Zero(), before = Vector6d::Zero();
  for (std::size_t k = 1; k < drive.steps.size(); ++k) {
    const Vector6d d = drive.steps[k].true_twist[0] - drive.steps[k - 1].true_twist[0];
    sum += d.cwiseAbs2();
    lagged += d.cwiseProduct(before);
    before = d;
  }
  const double n = static_cast<double>(drive.steps.size() - 1), dt = 0.1;
  Vector6d density;
  density << 0.5, 0.15, 0.15, 0.1, 0.1, 0.1;
  for (int i = 0; i < 6; ++i) {
    const double variance = density[i] * density[i] * dt;
    EXPECT_NEAR(sum[i] / n, variance, 4.0 * variance * std::sqrt(2.0 / n)) << i;
    EXPECT_NEAR(lagged[i] / n, 0.0, 4.0 * variance / std::sqrt(n)) << i;
  }
}

TEST(Motion, TwistDecayKeepsTheTwistBounded) {
  DriveOptions options;
  options.motion = MotionModel::kProcessModel;
  options.duration = 2000.0;
  options.twist_decay = 5.0;
  options.features_max = 1;
  options.features_min = 0;
  double sum = 0.0, squares = 0.0;
  const Drive drive = simulateDrive(options);
  for (const DriveStep& step : drive.steps) {
    const double v = step.true_twist.front()[0];
    sum += v;
    squares += v * v;
  }
  const double n = static_cast<double>(drive.steps.size()), mean = sum / n;
  EXPECT_NEAR(mean, options.speed, 0.5);
  EXPECT_NEAR(squares / n - mean * mean, 0.5 * 5.0 * 0.25, 0.2); // tau q^2 / 2
}

TEST(Samples, NoiseAndBiasAreThoseOfTheOptions) {
  DriveOptions options;
  options.seed = 11;
  options.imu_rate = 100.0;
  options.velocity_bias_sigma = 0.2;
  const Drive drive = simulateDrive(options);
  Vector6d sum = Vector6d::Zero(), squares = Vector6d::Zero(), bias;
  bias << drive.velocity_bias, drive.gyro_bias;
  double n = 0.0;
  for (const DriveStep& step : drive.steps) {
    ASSERT_EQ(step.gyro.size(), 10u);
    for (std::size_t j = 0; j < step.gyro.size(); ++j, n += 1.0) {
      Vector6d noise;
      noise << step.velocity[j].linear_velocity, step.gyro[j].angular_velocity;
      noise -= step.true_twist[j];
      sum += noise;
      squares += (noise - bias).cwiseAbs2();
    }
  }
  for (int i = 0; i < 6; ++i) {
    const double sigma = i < 3 ? options.velocity_sigma : options.gyro_sigma;
    EXPECT_NEAR(sum[i] / n, bias[i], 4.0 * sigma / std::sqrt(n)) << i;
    EXPECT_NEAR(squares[i] / n, sigma * sigma, 4.0 * sigma * sigma * std::sqrt(2.0 / n)) << i;
  }
}

TEST(Samples, CarryTheCovarianceOfTheirNoise) {
  DriveOptions options;
  options.duration = 1.0;
  options.velocity_sigma = 0.25;
  options.gyro_sigma = 0.0;
  const DriveStep step = *DriveSimulator(options).next();
  ASSERT_TRUE(step.velocity.front().covariance.has_value());
  EXPECT_EQ(*step.velocity.front().covariance, 0.0625 * Eigen::Matrix3d::Identity());
  EXPECT_FALSE(step.gyro.front().covariance.has_value());
  options.gyro_sigma = 0.5;
  EXPECT_EQ(*DriveSimulator(options).next()->gyro.front().covariance, 0.25 * Eigen::Matrix3d::Identity());
}

TEST(Samples, GyroBiasesFillTheirRangeWithEitherSign) {
  int positive = 0, low_half = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    DriveOptions options;
    options.seed = seed;
    const Eigen::Vector3d bias = DriveSimulator(options).gyroBias();
    for (int i = 0; i < 3; ++i) {
      EXPECT_GE(std::abs(bias[i]), options.gyro_bias_min);
      EXPECT_LE(std::abs(bias[i]), options.gyro_bias_max);
      positive += bias[i] > 0.0 ? 1 : 0;
      low_half += std::abs(bias[i]) < 0.007 ? 1 : 0;
    }
  }
  EXPECT_NEAR(positive, 150, 40);
  EXPECT_NEAR(low_half, 150, 40);
}

TEST(Samples, StampsStartAndStepAsTold) {
  DriveOptions options;
  options.duration = 2.0;
  options.imu_rate = 30.0;
  const Drive drive = simulateDrive(options);
  ASSERT_EQ(drive.steps.size(), 20u);
  for (const DriveStep& step : drive.steps) {
    const Stamp expected = 1317386425562500000 + 100000000 * static_cast<Stamp>(step.index);
    EXPECT_EQ(step.stamp, expected);
    EXPECT_EQ(step.frame.stamp, expected);
    ASSERT_EQ(step.gyro.size(), 3u);
    EXPECT_EQ(step.gyro.front().stamp, expected);
    EXPECT_EQ(step.velocity.back().stamp, expected + 66666667);
  }
}

TEST(Samples, KeepTheirRateWhateverThatOfTheFrames) {
  for (const double frame_rate : {5.0, 10.0, 30.0}) {
    for (const double imu_rate : {10.0, 100.0, 400.0}) {
      DriveOptions options;
      options.duration = 3.0;
      options.frame_rate = frame_rate;
      options.imu_rate = imu_rate;
      const Drive drive = simulateDrive(options);
      std::size_t samples = 0;
      for (const DriveStep& step : drive.steps) {
        for (std::size_t j = 0; j < step.gyro.size(); ++j, ++samples) {
          const double since_start = secondsBetween(drive.steps.front().stamp, step.gyro[j].stamp);
          ASSERT_NEAR(since_start, static_cast<double>(samples) / imu_rate, 1e-9);
          ASSERT_EQ(step.velocity[j].stamp, step.gyro[j].stamp);
          ASSERT_GE(step.gyro[j].stamp, step.stamp);
          ASSERT_LT(secondsBetween(step.stamp, step.gyro[j].stamp), 1.0 / frame_rate + 1e-9);
        }
      }
      EXPECT_EQ(samples, static_cast<std::size_t>(3.0 * imu_rate)) << frame_rate;
    }
  }
}

} // namespace
} // namespace vi_ekf_slam::simulation

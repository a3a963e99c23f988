#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/simulation/inertial/handheld.hpp"
#include "vi_ekf_slam/simulation/inertial/smooth_car.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam::simulation {
namespace {

std::unique_ptr<Trajectory> trajectoryOf(const DriveOptions& options) {
  if (options.motion == MotionModel::kHandheld) return std::make_unique<HandheldTrajectory>(options);
  return std::make_unique<SmoothCarTrajectory>(options);
}

DriveOptions optionsOf(MotionModel motion, std::uint64_t seed, double standing_start) {
  DriveOptions options = studyOptions(motion);
  options.seed = seed;
  options.duration = 60.0;
  options.standing_start = standing_start;
  return options;
}

TEST(Trajectory, DerivativesAreThoseOfThePose) {
  constexpr double h = 1e-4; // s
  for (const MotionModel motion : {MotionModel::kHandheld, MotionModel::kInertialCar}) {
    for (const double rest : {0.0, 2.0}) {
      const auto trajectory = trajectoryOf(optionsOf(motion, 3, rest));
      for (double t = 0.013; t < 60.0; t += 0.0917) {
        const Kinematics before = trajectory->at(t - h), now = trajectory->at(t),
                         after = trajectory->at(t + h);
        const Eigen::Vector3d velocity =
            (after.world_T_imu.translation() - before.world_T_imu.translation()) / (2.0 * h);
        const Eigen::Vector3d acceleration = (after.velocity - before.velocity) / (2.0 * h);
        const Eigen::Vector3d rate =
            so3::Log(before.world_T_imu.rotation().transpose() * after.world_T_imu.rotation()) / (2.0 * h);
        ASSERT_LT((velocity - now.velocity).norm(), 1e-5) << nameOf(motion) << " at " << t;
        ASSERT_LT((acceleration - now.acceleration).norm(), 1e-4) << nameOf(motion) << " at " << t;
        ASSERT_LT((rate - now.angular_velocity).norm(), 1e-4) << nameOf(motion) << " at " << t;
      }
    }
  }
}

TEST(Trajectory, AccelerationIsContinuous) {
  for (const MotionModel motion : {MotionModel::kHandheld, MotionModel::kInertialCar}) {
    const auto trajectory = trajectoryOf(optionsOf(motion, 4, 2.0));
    for (double t = 0.0; t < 60.0; t += 1e-3) {
      const Kinematics now = trajectory->at(t), after = trajectory->at(t + 1e-3);
      ASSERT_LT((after.acceleration - now.acceleration).norm(), 0.25) << nameOf(motion) << " at " << t;
      ASSERT_LT((after.angular_velocity - now.angular_velocity).norm(), 0.1) << nameOf(motion) << " at " << t;
    }
  }
}

TEST(Trajectory, RestsAsLongAsToldAndNoLonger) {
  for (const MotionModel motion : {MotionModel::kHandheld, MotionModel::kInertialCar}) {
    const auto trajectory = trajectoryOf(optionsOf(motion, 5, 3.0));
    for (double t = 0.0; t <= 3.0; t += 0.01) {
      const Kinematics now = trajectory->at(t);
      ASSERT_LT(now.velocity.norm() + now.acceleration.norm() + now.angular_velocity.norm(), 1e-12) << t;
    }
    EXPECT_GT(trajectory->at(5.5).velocity.norm(), 0.05) << nameOf(motion);
  }
  EXPECT_GT(trajectoryOf(optionsOf(MotionModel::kInertialCar, 5, 0.0))->at(0.0).velocity.norm(), 3.0);
}

TEST(Handheld, ReachesItsLimitsAndKeepsThem) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    for (const double peak : {9.81, 2.0}) {
      DriveOptions options = optionsOf(MotionModel::kHandheld, seed, 2.0);
      options.peak_acceleration = peak;
      options.peak_rate = 0.3 * peak;
      const HandheldTrajectory trajectory(options);
      double fastest = 0.0, most = 0.0, squares = 0.0;
      int n = 0;
      for (double t = 0.0; t < 125.0; t += 0.003, ++n) {
        const Kinematics now = trajectory.at(t);
        fastest = std::max(fastest, now.angular_velocity.norm());
        most = std::max(most, now.acceleration.norm());
        squares += now.acceleration.squaredNorm();
        ASSERT_TRUE(trajectory.extent().contains(now.world_T_imu.translation()) ||
                    trajectory.extent().exteriorDistance(now.world_T_imu.translation()) < 1e-3);
      }
      EXPECT_LE(most, options.peak_acceleration) << seed;
      EXPECT_GT(most, 0.97 * options.peak_acceleration) << seed;
      EXPECT_LE(fastest, options.peak_rate) << seed;
      EXPECT_GT(fastest, 0.97 * options.peak_rate) << seed;
      EXPECT_LT(std::sqrt(squares / n), 0.5 * options.peak_acceleration) << seed;
    }
  }
}

TEST(SmoothCar, DrivesTheLapWithACarsAccelerations) {
  DriveOptions options = studyOptions(MotionModel::kInertialCar);
  const SmoothCarTrajectory car(options);
  const BlockPath path(options.block_length, options.block_width);
  for (double t = 0.0; t < 60.0; t += 0.01) {
    const Kinematics now = car.at(t);
    const double s = car.distance(t);
    ASSERT_LT(now.acceleration.norm(), 5.0) << t;
    ASSERT_LT(now.velocity.norm(), options.speed + 0.1) << t;
    ASSERT_LT((path.path_T_imu(s).translation() - now.world_T_imu.translation()).norm(), 0.3) << t;
  }
}

} // namespace
} // namespace vi_ekf_slam::simulation

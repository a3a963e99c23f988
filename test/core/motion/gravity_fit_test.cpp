// Gravity, velocity and their uncertainty from poses and accelerations.

#include "vi_ekf_slam/core/motion/gravity_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "inertial_core.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kBiasSigma = 0.05;

/// A body of steady rate and specific force, for which propagation in steps is exact, seen in a frame in
/// which gravity points anywhere.
struct Seen {
  Seen(Random& random, double seconds, double pose_rate, double imu_rate, bool at_rest) {
    gravity = kGravity * random.direction();
    gyro_bias = random.vector<3>(-0.05, 0.05);
    Eigen::Matrix3d R = so3::Exp(random.vector<3>(-2.0, 2.0));
    Eigen::Vector3d p = random.vector<3>(-3.0, 3.0), v = Eigen::Vector3d::Zero();
    Eigen::Vector3d w = Eigen::Vector3d::Zero(), a = -(R.transpose() * gravity);
    if (!at_rest) {
      v = random.vector<3>(-2.0, 2.0);
      w = random.vector<3>(-0.5, 0.5);
      a += random.vector<3>(-2.0, 2.0);
    }
    velocity = v;
    const int steps = static_cast<int>(std::lround(seconds * imu_rate)),
              every = static_cast<int>(std::lround(imu_rate / pose_rate));
    const double dt = 1.0 / imu_rate;
    for (int i = 0; i <= steps; ++i) {
      ImuSample sample;
      sample.stamp = fromSeconds(100.0 + i * dt);
      sample.angular_velocity = w + gyro_bias;
      sample.acceleration = a;
      samples.push_back(sample);
      if (i % every == 0) poses.push_back({sample.stamp, SE3(R, p), Eigen::Vector3d::Constant(1e-3)});
      p += dt * v + dt * dt * (R * so3::secondIntegral(dt * w) * a + 0.5 * gravity);
      v += dt * (R * so3::leftJacobian(dt * w) * a + gravity);
      R *= so3::Exp(dt * w);
    }
  }
  std::optional<GravityFit> fit() const {
    return fitGravity(poses, samples, gyro_bias, kBiasSigma, kGravity);
  }

  Eigen::Vector3d gravity, velocity, gyro_bias;
  std::vector<SeenPose> poses;
  std::vector<ImuSample> samples;
};

TEST(GravityFit, ExactDataGiveGravityAndVelocity) {
  Random random(1);
  for (int run = 0; run < 20; ++run) {
    const Seen seen(random, 1.5, 10.0, 200.0, run % 4 == 0);
    const auto fit = seen.fit();
    ASSERT_TRUE(fit);
    EXPECT_LT(distance(fit->gravity, seen.gravity), 1e-6) << run;
    EXPECT_LT(distance(fit->velocity, seen.velocity), 1e-6) << run;
    EXPECT_NEAR(fit->free_length, kGravity, 1e-6) << run;
    EXPECT_LT(fit->misfit, 1e-5) << run;
    EXPECT_GT(fit->tilt_sigma, 0.0);
    EXPECT_LT(fit->tilt_sigma, 0.05);
  }
}

TEST(GravityFit, PosesNeedNotBeOfTheSamplesStamps) {
  Random random(2);
  Seen seen(random, 1.5, 10.0, 200.0, false);
  // Every other sample is lost: poses lie between those that are left too, and the input is steady.
  std::vector<ImuSample> kept;
  for (std::size_t i = 1; i < seen.samples.size(); i += 3) kept.push_back(seen.samples[i]);
  kept.insert(kept.begin(), seen.samples.front());
  seen.samples = kept;
  const auto fit = seen.fit();
  ASSERT_TRUE(fit);
  EXPECT_LT(distance(fit->gravity, seen.gravity), 1e-6);
  EXPECT_LT(distance(fit->velocity, seen.velocity), 1e-6);
}

// Noise on the positions, more on the first one, and a constant bias, as the fit is told of them.
TEST(GravityFit, ErrorsAreThoseOfItsCovariance) {
  for (const bool at_rest : {false, true}) {
    double tilt2 = 0.0, length2 = 0.0, misfit2 = 0.0;
    constexpr int kSeeds = 50;
    for (int seed = 0; seed < kSeeds; ++seed) {
      Random random(static_cast<unsigned>(100 + seed));
      Seen seen(random, 1.5, 20.0, 200.0, at_rest);
      const Eigen::Vector3d bias = random.gaussian<3>(kBiasSigma);
      for (ImuSample& sample : seen.samples) *sample.acceleration += bias;
      for (SeenPose& pose : seen.poses) {
        pose.position_sigma << 1e-3, 2e-3, 4e-3;
        if (pose.stamp == seen.poses.front().stamp) pose.position_sigma *= 10.0;
        const Eigen::Vector3d error = pose.position_sigma.cwiseProduct(random.gaussian<3>(1.0));
        pose.frame_T_imu = SE3(pose.frame_T_imu.rotation(), pose.frame_T_imu.translation() + error);
      }
      const auto fit = seen.fit();
      ASSERT_TRUE(fit);
      EXPECT_NEAR(fit->gravity.norm(), kGravity, 1e-12);
      const double angle = std::asin(fit->gravity.cross(seen.gravity).norm() / (kGravity * kGravity));
      tilt2 += std::pow(angle / fit->tilt_sigma, 2) / kSeeds;
      length2 += std::pow((fit->free_length - kGravity) / fit->free_length_sigma, 2) / kSeeds;
      misfit2 += fit->misfit * fit->misfit / kSeeds;
    }
    // The mean of 50 chi-squares, of 2 degrees of freedom (whose larger axis is told: 1 to 2) and of 1.
    EXPECT_GT(tilt2, 0.6) << at_rest;
    EXPECT_LT(tilt2, 3.0) << at_rest;
    EXPECT_GT(length2, 0.4) << at_rest;
    EXPECT_LT(length2, 1.8) << at_rest;
    EXPECT_NEAR(misfit2, 1.0, 0.2) << at_rest;
  }
}

TEST(GravityFit, TellsAnotherUnitByTheLength) {
  Random random(3);
  Seen seen(random, 1.5, 10.0, 200.0, true);
  for (ImuSample& sample : seen.samples) *sample.acceleration /= kGravity;
  const auto fit = seen.fit();
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->free_length, 1.0, 1e-6);
}

TEST(GravityFit, IsRefusedWithTooFewPosesOrNoSamples) {
  Random random(4);
  Seen seen(random, 1.5, 10.0, 200.0, false);
  Seen few = seen;
  few.poses.resize(4);
  EXPECT_TRUE(few.fit());
  few.poses.resize(3);
  EXPECT_FALSE(few.fit());
  few.poses.clear();
  EXPECT_FALSE(few.fit());
  seen.samples.clear();
  EXPECT_FALSE(seen.fit());
}

TEST(GravityFit, IsRefusedWherePosesAreOfOneTime) {
  Random random(5);
  Seen seen(random, 1.5, 10.0, 200.0, false);
  for (SeenPose& pose : seen.poses) pose.stamp = seen.poses.front().stamp;
  const auto fit = seen.fit();
  EXPECT_FALSE(fit && fit->gravity.allFinite() && fit->tilt_sigma < 1.0);
}

} // namespace
} // namespace vi_ekf_slam::test

#include "vi_ekf_slam/simulation/track_drift.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kPosition = 0.02, kRotation = 0.001; // m/m^0.5, rad/m^0.5

/// Where the car is after `frame` tenths of a second: 9 m/s along a bend, with speed `factor` times that.
SE3 poseAt(double frame, double factor = 1.0) {
  return SE3::Exp((Vector6d() << 0.9, 0.0, 0.0, 0.0, 0.0, 0.002).finished() * (factor * frame));
}

DriveOptions driftOptions(double position, double rotation, std::uint64_t seed = 1) {
  DriveOptions options;
  options.seed = seed;
  options.drift_position = position;
  options.drift_rotation = rotation;
  return options;
}

constexpr int kFrames = 600; // 540 m, 120 time constants

/// Where the world seems to be after a drive.
SE3 slideOf(const DriveOptions& options, double factor = 1.0) {
  TrackDrift drift(options);
  for (int k = 0; k <= kFrames; ++k) drift.advance(fromSeconds(100.0 + 0.1 * k), poseAt(k, factor));
  return drift.slide();
}

/// Second moments of (position, rotation) of the slides of 500 seeds.
Matrix6d momentsOf(double position, double rotation) {
  constexpr int kSlides = 500;
  Matrix6d moments = Matrix6d::Zero();
  for (int seed = 1; seed <= kSlides; ++seed) {
    const SE3 slide = slideOf(driftOptions(position, rotation, static_cast<std::uint64_t>(seed)));
    Vector6d moved; // of a point where the car is now
    const Eigen::Vector3d here = poseAt(kFrames).translation();
    moved << slide * here - here, so3::Log(slide.rotation());
    moments += moved * moved.transpose() / kSlides;
  }
  return moments;
}

/// `moments` in units of the sigmas of `expected`, less `expected` in the same: largest element.
double differenceInSigmas(const Matrix6d& moments, const Matrix6d& expected) {
  const Vector6d scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * (moments - expected) * scale.asDiagonal();
  return scaled.cwiseAbs().maxCoeff();
}

TEST(TrackDrift, IsNoneWithoutDensities) {
  EXPECT_EQ(slideOf(driftOptions(0.0, 0.0)).matrix(), Eigen::Matrix4d::Identity());
}

TEST(TrackDrift, ShiftsByItsDensityOverTheDistance) {
  const Matrix6d moments = momentsOf(kPosition, 0.0);
  const double expected = kPosition * kPosition * 0.9 * kFrames;
  // 500 seeds tell a variance to 6 %, and three axes their mean to 4 %.
  EXPECT_NEAR(moments.topLeftCorner(3, 3).trace() / 3.0, expected, 0.12 * expected);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(moments(i, i), expected, 0.25 * expected) << i;
  EXPECT_EQ(moments.bottomRightCorner(3, 3).cwiseAbs().maxCoeff(), 0.0);
}

TEST(TrackDrift, ShiftsAsFarAtAnyFrameRate) {
  constexpr int kSlides = 500;
  const double expected = kPosition * kPosition * 0.9 * kFrames;
  for (const double rate : {5.0, 30.0}) {
    double sum = 0.0;
    for (int seed = 1; seed <= kSlides; ++seed) {
      TrackDrift drift(driftOptions(kPosition, 0.0, static_cast<std::uint64_t>(seed)));
      for (int k = 0; k <= 0.1 * kFrames * rate; ++k)
        drift.advance(fromSeconds(100.0 + k / rate), poseAt(10.0 * k / rate));
      sum += drift.slide().translation().squaredNorm() / 3.0 / kSlides;
    }
    EXPECT_NEAR(sum, expected, 0.12 * expected) << rate;
  }
}

TEST(TrackDrift, TurnsByItsDensityOverTheDistance) {
  const Matrix6d moments = momentsOf(0.0, kRotation);
  const double expected = kRotation * kRotation * 0.9 * kFrames;
  EXPECT_NEAR(moments.bottomRightCorner(3, 3).trace() / 3.0, expected, 0.12 * expected);
  for (int i = 3; i < 6; ++i) EXPECT_NEAR(moments(i, i), expected, 0.25 * expected) << i;
}

/// Of (position, rotation) where the car is now: each step shifts by white noise, and turns about where the
/// car was then.
Matrix6d expectedMoments() {
  const Eigen::Vector3d here = poseAt(kFrames).translation();
  Matrix6d sum = Matrix6d::Zero();
  for (int k = 0; k < kFrames; ++k) {
    Matrix6d J = Matrix6d::Identity();
    J.topRightCorner<3, 3>() = -so3::hat(here - poseAt(k).translation());
    Vector6d variance;
    variance << Eigen::Vector3d::Constant(kPosition * kPosition * 0.9),
        Eigen::Vector3d::Constant(kRotation * kRotation * 0.9);
    sum += J * variance.asDiagonal() * J.transpose();
  }
  return sum;
}

TEST(TrackDrift, IsARandomWalkOverTheDistanceWithItsLeverArm) {
  const Matrix6d expected = expectedMoments();
  EXPECT_GT(expected(1, 1), 2.0 * kPosition * kPosition * 0.9 * kFrames); // the lever arm counts here
  EXPECT_LT(differenceInSigmas(momentsOf(kPosition, kRotation), expected), 0.25);
}

TEST(TrackDrift, IsNoneWhileTheCarStands) {
  EXPECT_EQ(slideOf(driftOptions(kPosition, kRotation), 0.0).matrix(), Eigen::Matrix4d::Identity());
}

TEST(TrackDrift, DoesNotHopFromFrameToFrame) {
  // Correlated over half a second: neighbouring steps are alike, those of 3 s later are not.
  TrackDrift drift(driftOptions(kPosition, 0.0));
  std::vector<Eigen::Vector3d> steps;
  Eigen::Vector3d last = Eigen::Vector3d::Zero();
  for (int k = 0; k < 20000; ++k) {
    drift.advance(fromSeconds(100.0 + 0.1 * k), poseAt(k));
    steps.push_back(drift.slide().translation() - last);
    last = drift.slide().translation();
  }
  const auto correlation = [&](std::size_t lag) {
    double with = 0.0, own = 0.0;
    for (std::size_t k = 1; k + lag < steps.size(); ++k) {
      with += steps[k].dot(steps[k + lag]);
      own += steps[k].squaredNorm();
    }
    return with / own;
  };
  EXPECT_NEAR(correlation(1), std::exp(-0.2), 0.04);
  EXPECT_NEAR(correlation(5), std::exp(-1.0), 0.08);
  EXPECT_NEAR(correlation(30), 0.0, 0.1);
}

/// Pixels without noise, correct matches, no stale frames.
DriveOptions exactOptions() {
  DriveOptions options;
  options.duration = 40.0;
  options.pixel_sigma = options.outlier_fraction = options.stale_fraction = 0.0;
  options.moving_objects = 0;
  return options;
}

TEST(TrackDrift, LeavesANewTrackExactAndMovesAnOldOne) {
  DriveOptions options = exactOptions();
  options.drift_position = kPosition;
  options.drift_rotation = kRotation;
  const Drive drive = simulateDrive(options);
  std::map<FeatureId, int> age;
  double worst_new = 0.0, young = 0.0, old = 0.0; // px, and px^2
  int young_count = 0, old_count = 0;
  for (const DriveStep& step : drive.steps) {
    for (std::size_t i = 0; i < step.frame.features.size(); ++i) {
      const Eigen::Vector3d p = drive.rig.cam_T_imu * (step.world_T_imu.inverse() * step.truth[i].world);
      const StereoPixels off = step.frame.features[i].pixels - drive.rig.camera.project(p);
      const int seen = age[step.frame.features[i].id]++;
      if (seen == 0) worst_new = std::max(worst_new, off.norm());
      if (seen == 1) {
        young += off.squaredNorm();
        ++young_count;
      }
      if (seen == 10) {
        old += off.squaredNorm();
        ++old_count;
      }
    }
  }
  EXPECT_LT(worst_new, 1e-9);
  ASSERT_GT(old_count, 200);
  // It has slid since it was new, whenever that was.
  EXPECT_LT(std::sqrt(young / young_count), 1.0);
  EXPECT_GT(std::sqrt(old / old_count), 2.0 * std::sqrt(young / young_count));
  EXPECT_GT(std::sqrt(old / old_count), 0.5); // px; 9 m turn by 3 mrad, of 700 px a rad
}

bool sameDrive(const Drive& a, const Drive& b, bool pixels) {
  if (a.steps.size() != b.steps.size()) return false;
  for (std::size_t k = 0; k < a.steps.size(); ++k) {
    if (a.steps[k].world_T_imu.matrix() != b.steps[k].world_T_imu.matrix()) return false;
    if (a.steps[k].gyro[0].angular_velocity != b.steps[k].gyro[0].angular_velocity) return false;
    const auto &x = a.steps[k].frame.features, &y = b.steps[k].frame.features;
    if (!pixels) continue;
    if (x.size() != y.size()) return false;
    for (std::size_t i = 0; i < x.size(); ++i) {
      if (x[i].id != y[i].id || x[i].pixels != y[i].pixels) return false;
    }
  }
  return true;
}

TEST(TrackDrift, OfASeedIsAlwaysTheSame) {
  DriveOptions options = driftOptions(kPosition, kRotation, 3);
  options.duration = 20.0;
  const Drive drive = simulateDrive(options);
  EXPECT_TRUE(sameDrive(drive, simulateDrive(options), true));
  EXPECT_NE(slideOf(driftOptions(kPosition, kRotation, 3)).matrix(),
            slideOf(driftOptions(kPosition, kRotation, 4)).matrix());
  // It moves neither the car nor the other sensors.
  options.drift_position = options.drift_rotation = 0.0;
  const Drive without = simulateDrive(options);
  EXPECT_TRUE(sameDrive(drive, without, false));
  EXPECT_FALSE(sameDrive(drive, without, true));
}

} // namespace
} // namespace vi_ekf_slam::simulation

#include <gtest/gtest.h>

#include <algorithm>

#include "../numeric.hpp"
#include "../street.hpp"
#include "reference.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/motion/dead_reckoning.hpp"
#include "vi_ekf_slam/core/paper/paper_estimator.hpp"

namespace vi_ekf_slam::paper {
namespace {

using test::distance;
using test::exampleRig;
using test::kStep;
using test::numericJacobian;
using test::relativeDistance;
using test::sharpConfig;
using test::Street;
using test::streetTwist;

/// Drives the estimator along the street; the camera's pixels are off by `shift`.
void drive(PaperEstimator& estimator, DeadReckoning& dead_reckoning, double shift, int frames) {
  Street street(9, 60);
  SE3 world_T_imu;
  for (int k = 0; k < frames; ++k) {
    const Stamp stamp = fromSeconds(kStep * k);
    const Vector6d u = streetTwist(kStep * k);
    const ImuSample gyro{stamp, u.tail<3>(), {}};
    const VelocitySample velocity{stamp, u.head<3>(), {}};
    StereoFrame frame = street.frame(stamp, world_T_imu, 0.0);
    for (auto& feature : frame.features) feature.pixels += StereoPixels(shift * k, 0.0, shift * k, 0.0);
    estimator.process(gyro);
    estimator.process(velocity);
    estimator.process(frame);
    dead_reckoning.process(gyro);
    dead_reckoning.process(velocity);
    world_T_imu = world_T_imu * SE3::Exp(kStep * u);
  }
}

double awayFromDeadReckoning(const PaperConfig& config, double shift) {
  PaperEstimator estimator(config);
  estimator.setRig(exampleRig());
  DeadReckoning dead_reckoning;
  drive(estimator, dead_reckoning, shift, 60);
  return distance(estimator.state().world_T_imu.matrix(), dead_reckoning.pose().matrix());
}

TEST(PaperEstimator, WithTheVOfThePaperTheCameraIsInEffectOff) {
  PaperConfig config;
  config.landmark_fraction = 1.0;
  EXPECT_LT(awayFromDeadReckoning(config, 2.0), 1e-3); // pixels that drift by 120 px in all
  config.pixel_noise = 4.0;
  EXPECT_GT(awayFromDeadReckoning(config, 2.0), 0.1) << "the same pixels with a sensible V";
}

TEST(PaperEstimator, DeadReckoningModeIsDeadReckoning) {
  PaperConfig config = sharpConfig(PaperMode::kDeadReckoning);
  PaperEstimator estimator(config);
  estimator.setRig(exampleRig());
  DeadReckoning dead_reckoning;
  drive(estimator, dead_reckoning, 3.0, 60);
  EXPECT_LT(distance(estimator.state().world_T_imu.matrix(), dead_reckoning.pose().matrix()), 1e-12);
  EXPECT_EQ(distance(estimator.state().twist, dead_reckoning.twist()), 0.0);
  EXPECT_TRUE(estimator.landmarks().empty());
}

TEST(PaperEstimator, MappingModeKeepsTheDeadReckonedPoseAndMapsAlongIt) {
  const PaperConfig config = sharpConfig(PaperMode::kMapping);
  PaperEstimator estimator(config);
  estimator.setRig(exampleRig());
  DeadReckoning dead_reckoning;
  drive(estimator, dead_reckoning, 0.0, 60);
  EXPECT_LT(distance(estimator.state().world_T_imu.matrix(), dead_reckoning.pose().matrix()), 1e-12);
  const Street street(9, 60);
  const auto landmarks = estimator.landmarks();
  EXPECT_GT(landmarks.size(), 20U);
  EXPECT_TRUE(std::is_sorted(landmarks.begin(), landmarks.end(),
                             [](const auto& a, const auto& b) { return a.id < b.id; }));
  for (const auto& landmark : landmarks) {
    EXPECT_LT(distance(landmark.position, street.points()[landmark.id]), 1e-6);
  }
}

TEST(PaperEstimator, UsesTheStatedFractionOfTheLandmarks) {
  for (const PaperMode mode : {PaperMode::kMapping, PaperMode::kSlam}) {
    PaperConfig config = sharpConfig(mode);
    config.landmark_fraction = 0.2;
    PaperEstimator estimator(config);
    estimator.setRig(exampleRig());
    StereoFrame frame;
    for (FeatureId id = 500; id < 600; ++id) {
      frame.features.push_back(
          {id, exampleRig().camera.project({0.01 * (static_cast<double>(id) - 550.0), 0.0, 5.0})});
    }
    const FrameReport report = estimator.process(frame);
    EXPECT_EQ(report.features, 100U);
    EXPECT_EQ(report.initialised, 20U);
    EXPECT_EQ(estimator.process(frame).used, 20U);
    EXPECT_EQ(estimator.landmarks().size(), 20U);
  }
}

TEST(PaperEstimator, WithoutARigFramesOnlyAdvanceTheClock) {
  for (const PaperMode mode : {PaperMode::kMapping, PaperMode::kSlam}) {
    PaperEstimator estimator(sharpConfig(mode));
    estimator.process(VelocitySample{0, {1.0, 0.0, 0.0}, {}});
    const FrameReport report =
        estimator.process(StereoFrame{2000000000, {{1, {600.0, 180.0, 580.0, 180.0}}}});
    EXPECT_EQ(report.features, 1U);
    EXPECT_EQ(report.invalid, 1U);
    EXPECT_EQ(report.stamp, 2000000000);
    EXPECT_EQ(estimator.state().stamp, 2000000000);
    EXPECT_LT(distance(estimator.state().world_T_imu.translation(), Eigen::Vector3d(2.0, 0.0, 0.0)), 1e-15);
    EXPECT_TRUE(estimator.landmarks().empty());
  }
}

TEST(PaperEstimator, MotionNoiseGrowsWithTimeNotWithTheNumberOfSteps) {
  const PaperConfig config = sharpConfig(PaperMode::kDeadReckoning);
  PaperEstimator once(config), often(config);
  for (Stamp t = 0; t <= 1000; t += 1000) once.process(ImuSample{t * 1000000, Eigen::Vector3d::Zero(), {}});
  for (Stamp t = 0; t <= 1000; t += 10) often.process(ImuSample{t * 1000000, Eigen::Vector3d::Zero(), {}});
  const Matrix6d expected =
      (config.prior_pose_variance + 10 * 1e-4) * Matrix6d::Identity(); // 1 s is ten steps
  EXPECT_LT(distance(once.state().pose_covariance, expected), 1e-15);
  EXPECT_LT(distance(often.state().pose_covariance, expected), 1e-15);
}

TEST(PaperEstimator, StateGivesTheCovarianceOfErrorsAlongTheWorldAxes) {
  PaperConfig config = sharpConfig(PaperMode::kDeadReckoning);
  config.motion_noise << 1e-3, 2e-3, 5e-4, 1e-4, 3e-4, 2e-4; // unlike in each direction, so that axes matter
  PaperEstimator estimator(config);
  SE3 imu_T_world;
  Matrix6d inner = config.prior_pose_variance * Matrix6d::Identity();
  for (int k = 0; k < 40; ++k) {
    const Vector6d u = streetTwist(kStep * k);
    const Stamp stamp = fromSeconds(kStep * k);
    estimator.process(ImuSample{stamp, u.tail<3>(), {}});
    estimator.process(VelocitySample{stamp, u.head<3>(), {}});
    if (k < 39) predict(u, kStep, config.motion_noise.asDiagonal(), imu_T_world, inner);
  }
  const StateEstimate state = estimator.state();
  ASSERT_LT(distance(state.world_T_imu.matrix(), imu_T_world.inverse().matrix()), 1e-12);
  ASSERT_GT(distance(state.world_T_imu.rotation(), Eigen::Matrix3d::Identity()), 0.1);

  // U = Exp(delta) U^ moves the pose by p = p^ + dp and R = Exp(dtheta) R^, both along the world axes.
  const SE3 mean = imu_T_world.inverse();
  const auto world_error = [&](const Vector6d& delta) {
    const SE3 moved = (SE3::Exp(delta) * imu_T_world).inverse();
    Vector6d error;
    error << moved.translation() - mean.translation(),
        so3::Log(moved.rotation() * mean.rotation().transpose());
    return error;
  };
  const auto J = numericJacobian<6, 6>(world_error, Vector6d::Zero().eval());
  EXPECT_LT(relativeDistance(state.pose_covariance, J * inner * J.transpose()), 1e-9);
}

TEST(PaperEstimator, TwistCovarianceIsTheVarianceThatWStandsFor) {
  const PaperConfig config;
  const Matrix6d expected = 1e-4 / (0.1 * 0.1) * Matrix6d::Identity();
  EXPECT_LT(distance(PaperEstimator(config).state().twist_covariance, expected), 1e-15);
}

} // namespace
} // namespace vi_ekf_slam::paper

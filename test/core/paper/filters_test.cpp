#include "vi_ekf_slam/core/paper/filters.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "../covariances.hpp"
#include "../numeric.hpp"
#include "../street.hpp"
#include "reference.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::paper {
namespace {

using test::DenseFilter;
using test::distance;
using test::exampleRig;
using test::inverseOf;
using test::isPositive;
using test::kStep;
using test::Random;
using test::relativeDistance;
using test::sharpConfig;
using test::Street;
using test::streetTwist;

Matrix6d stepNoise(const PaperConfig& config) { return config.motion_noise.asDiagonal(); }

const LandmarkEstimate* find(const std::vector<LandmarkEstimate>& all, FeatureId id) {
  const auto it =
      std::find_if(all.begin(), all.end(), [id](const LandmarkEstimate& l) { return l.id == id; });
  return it == all.end() ? nullptr : &*it;
}

/// Ids seen before that the frame does not see.
bool somethingLeft(const std::set<FeatureId>& seen, const StereoFrame& frame) {
  std::set<FeatureId> now;
  for (const auto& feature : frame.features) now.insert(feature.id);
  return std::any_of(seen.begin(), seen.end(), [&](FeatureId id) { return now.count(id) == 0; });
}

TEST(LandmarkMapper, EqualsTheDenseUpdateOfEquation17) {
  const PaperConfig config = sharpConfig(PaperMode::kMapping);
  const StereoRig rig = exampleRig();
  Street street(1, 30);
  LandmarkMapper mapper(config);
  DenseFilter dense(rig, config, true);
  SE3 world_T_imu;
  std::set<FeatureId> seen;
  bool some_left = false;
  for (int k = 0; k < 80; ++k) {
    const StereoFrame frame = street.frame(k, world_T_imu, 1.5);
    mapper.update(rig, world_T_imu.inverse(), frame);
    dense.U = world_T_imu.inverse().matrix().cast<long double>();
    dense.update(frame);
    some_left = some_left || somethingLeft(seen, frame);
    for (const auto& feature : frame.features) seen.insert(feature.id);

    const auto landmarks = mapper.landmarks();
    ASSERT_EQ(landmarks.size(), dense.index.size());
    for (const auto& landmark : landmarks) {
      const Eigen::Index at = 3 * dense.index.at(landmark.id);
      ASSERT_LT(distance(landmark.position, dense.mean.segment(at, 3)), 1e-9) << k;
      ASSERT_LT(relativeDistance(landmark.covariance, dense.Sigma.block(at, at, 3, 3)), 1e-9) << k;
    }
    world_T_imu = world_T_imu * SE3::Exp(kStep * streetTwist(kStep * k));
  }
  EXPECT_GT(seen.size(), 15U);
  EXPECT_TRUE(some_left) << "the drive never left a landmark behind";

  // What the mapper does not store is zero in the dense filter too.
  test::Mat off_diagonal = dense.Sigma;
  for (Eigen::Index at = 0; at < off_diagonal.rows(); at += 3) off_diagonal.block(at, at, 3, 3).setZero();
  EXPECT_LT(static_cast<double>(off_diagonal.cwiseAbs().maxCoeff()), 1e-12);
}

TEST(LandmarkMapper, LeavesALandmarkOutOfViewAlone) {
  const PaperConfig config = sharpConfig(PaperMode::kMapping);
  const StereoRig rig = exampleRig();
  Street street(2, 30);
  LandmarkMapper mapper(config);
  StereoFrame frame = street.frame(0, SE3(), 0.5);
  ASSERT_GE(frame.features.size(), 2U);
  mapper.update(rig, SE3(), frame);
  const FeatureId gone = frame.features.front().id;
  const LandmarkEstimate before = *find(mapper.landmarks(), gone);
  frame = street.frame(1, SE3(), 0.5);
  frame.features.erase(frame.features.begin());
  mapper.update(rig, SE3(), frame);
  const LandmarkEstimate after = *find(mapper.landmarks(), gone);
  EXPECT_EQ(distance(before.position, after.position), 0.0);
  EXPECT_EQ(distance(before.covariance, after.covariance), 0.0);
}

TEST(LandmarkMapper, ConvergesToTheTruthAlongTheTrueTrajectory) {
  const PaperConfig config = sharpConfig(PaperMode::kMapping);
  Street street(3, 30);
  LandmarkMapper mapper(config);
  for (int k = 0; k < 400; ++k) mapper.update(exampleRig(), SE3(), street.frame(k, SE3(), 1.0));
  const auto landmarks = mapper.landmarks();
  ASSERT_FALSE(landmarks.empty());
  for (const auto& landmark : landmarks) {
    EXPECT_LT(distance(landmark.position, street.points()[landmark.id]), 0.1);
    EXPECT_EQ(distance(landmark.covariance, landmark.covariance.transpose()), 0.0);
    EXPECT_TRUE(isPositive(landmark.covariance));
  }
}

TEST(JointEkf, EqualsTheDenseUpdateOfEquations17And20) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  Street street(4, 40);
  Random random(5);
  JointEkf filter(config);
  DenseFilter dense(rig, config, false);
  SE3 world_T_imu;
  std::set<FeatureId> seen;
  int frames_with_some_gone = 0, frames_with_some_new = 0;
  for (int k = 0; k < 80; ++k) {
    const StereoFrame frame = street.frame(k, world_T_imu, 1.5);
    frames_with_some_gone += somethingLeft(seen, frame) ? 1 : 0;
    const FrameReport report = filter.update(rig, frame);
    frames_with_some_new += report.initialised > 0 ? 1 : 0;
    dense.update(frame);
    for (const auto& feature : frame.features) seen.insert(feature.id);

    const Vector6d u = streetTwist(kStep * k);
    const Vector6d measured = u + random.vector<6>(-0.05, 0.05);
    filter.predict(measured, kStep, stepNoise(config));
    dense.predict(measured, kStep, stepNoise(config));
    world_T_imu = world_T_imu * SE3::Exp(kStep * u);

    ASSERT_EQ(filter.covariance().rows(), dense.Sigma.rows());
    ASSERT_LT(distance(filter.imuTWorld().matrix(), dense.U), 1e-9) << k;
    ASSERT_LT(relativeDistance(filter.covariance(), dense.Sigma), 1e-9) << k;
    for (const auto& landmark : filter.landmarks()) {
      const Eigen::Index at = 3 * dense.index.at(landmark.id);
      ASSERT_LT(distance(landmark.position, dense.mean.segment(at, 3)), 1e-9) << k;
      ASSERT_LT(relativeDistance(landmark.covariance, dense.Sigma.block(6 + at, 6 + at, 3, 3)), 1e-9) << k;
    }
  }
  EXPECT_GT(frames_with_some_gone, 20);
  EXPECT_GT(frames_with_some_new, 5);
  EXPECT_LT(distance(filter.imuTWorld().inverse().translation(), world_T_imu.translation()), 0.3)
      << "the filter has to follow the drive, else the comparison says little";
}

TEST(JointEkf, EqualsTheDenseUpdateAtTheValuesOfThePaper) {
  PaperConfig config; // section IV-C
  config.landmark_fraction = 1.0;
  const StereoRig rig = exampleRig();
  Street street(6, 40);
  JointEkf filter(config);
  DenseFilter dense(rig, config, false);
  SE3 world_T_imu;
  for (int k = 0; k < 30; ++k) {
    const StereoFrame frame = street.frame(k, world_T_imu, 1.5);
    filter.update(rig, frame);
    dense.update(frame);
    const Vector6d u = streetTwist(kStep * k);
    filter.predict(u, kStep, stepNoise(config));
    dense.predict(u, kStep, stepNoise(config));
    world_T_imu = world_T_imu * SE3::Exp(kStep * u);
    ASSERT_LT(distance(filter.imuTWorld().matrix(), dense.U), 1e-9) << k;
    ASSERT_LT(relativeDistance(filter.covariance(), dense.Sigma), 1e-9) << k;
  }
}

TEST(JointEkf, ReportsTheNormalisedInnovationSquaredOfEquation20) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  JointEkf filter(config);
  const Eigen::Vector3d p_cam(0.5, 0.2, 8.0);
  StereoFrame frame{0, {{3, rig.camera.project(p_cam)}}};
  EXPECT_EQ(filter.update(rig, frame).nis_dof, 0U);
  const StereoPixels innovation(1.0, -0.5, 0.25, 0.75);
  const auto predicted = predictObservation(rig, filter.imuTWorld(), filter.landmarks()[0].position, 0.5);
  frame.features[0].pixels = predicted->pixels + innovation;
  Eigen::Matrix<double, 4, 9> H;
  H << predicted->by_pose, predicted->by_landmark;
  const Eigen::Matrix4d S =
      H * filter.covariance() * H.transpose() + config.pixel_noise * Eigen::Matrix4d::Identity();
  const FrameReport report = filter.update(rig, frame);
  EXPECT_EQ(report.used, 1U);
  EXPECT_EQ(report.nis_dof, 4U);
  EXPECT_NEAR(report.nis, innovation.dot(inverseOf(S) * innovation), 1e-9);
}

TEST(JointEkf, CorrectsALandmarkThatLeftViewThroughItsCorrelation) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  JointEkf filter(config);
  const Eigen::Vector3d staying(1.0, 0.5, 8.0), leaving(-1.5, 0.2, 6.0);
  const auto see = [&](const Eigen::Vector3d& p) { return rig.camera.project(p); };
  const StereoFrame both{0, {{1, see(staying)}, {2, see(leaving)}}};
  filter.update(rig, both);
  filter.update(rig, both); // now they are correlated, through the pose
  ASSERT_GT(filter.covariance().block(6, 9, 3, 3).cwiseAbs().maxCoeff(), 1e-4);

  const LandmarkEstimate before = *find(filter.landmarks(), 2);
  StereoFrame one{1, {{1, see(staying)}}};
  one.features[0].pixels += StereoPixels(4.0, 2.0, 3.0, 2.0);
  const FrameReport report = filter.update(rig, one);
  EXPECT_EQ(report.used, 1U);
  EXPECT_EQ(report.landmarks, 2U) << "nobody leaves the state";
  const LandmarkEstimate after = *find(filter.landmarks(), 2);
  EXPECT_GT(distance(before.position, after.position), 1e-4);
  EXPECT_LT(after.covariance.trace(), before.covariance.trace());
}

TEST(JointEkf, InitialisesByEquations6To8WithThePriorVarianceAndNoCorrelation) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  JointEkf filter(config);
  filter.predict(streetTwist(0.0), 1.0, stepNoise(config));
  const Matrix6d pose_covariance = filter.poseCovariance();
  const StereoPixels z = rig.camera.project({0.5, 0.2, 8.0}) + StereoPixels(0.3, -0.2, 0.1, 0.4);
  const FrameReport report = filter.update(rig, {0, {{77, z}}});
  EXPECT_EQ(report.initialised, 1U);
  EXPECT_EQ(report.used, 0U);
  ASSERT_EQ(filter.landmarks().size(), 1U);
  EXPECT_EQ(filter.landmarks()[0].id, 77U);
  const test::Mat U = filter.imuTWorld().matrix().cast<long double>();
  EXPECT_LT(distance(filter.landmarks()[0].position, test::initialPoint(rig, U, z.cast<long double>())),
            1e-12);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(9, 9);
  expected.topLeftCorner(6, 6) = pose_covariance;
  expected.bottomRightCorner(3, 3) = config.prior_landmark_variance * Eigen::Matrix3d::Identity();
  EXPECT_EQ(distance(filter.covariance(), expected), 0.0);
}

TEST(JointEkf, GrowsBeyondItsFirstCapacityWithoutForgetting) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  JointEkf filter(config);
  Random random(7);
  StereoFrame frame;
  for (FeatureId id = 0; id < 120; ++id) {
    const Eigen::Vector3d p(random.uniform(-4.0, 4.0), random.uniform(-2.0, 2.0), random.uniform(5.0, 12.0));
    frame.features.push_back({id, rig.camera.project(p)});
    if (id == 60) {
      filter.update(rig, frame);
      filter.update(rig, frame);
    }
  }
  const Eigen::MatrixXd before = filter.covariance();
  StereoFrame fresh;
  fresh.features.assign(frame.features.begin() + 61, frame.features.end());
  filter.update(rig, fresh);
  ASSERT_EQ(filter.covariance().rows(), 6 + 3 * 120);
  EXPECT_EQ(distance(filter.covariance().topLeftCorner(before.rows(), before.cols()), before), 0.0);
  EXPECT_EQ(filter.covariance().topRightCorner(before.rows(), 3 * 59).norm(), 0.0);
}

TEST(JointEkf, CountsWhatItDidNotUse) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  JointEkf filter(config);
  const StereoPixels good = rig.camera.project({0.5, 0.2, 8.0});
  StereoPixels broken = good;
  broken[1] = std::nan("");
  const StereoPixels flat(600.0, 180.0, 600.0, 180.0);
  const FrameReport report = filter.update(rig, {9, {{1, good}, {2, broken}, {3, flat}}});
  EXPECT_EQ(report.stamp, 9);
  EXPECT_EQ(report.features, 3U);
  EXPECT_EQ(report.initialised, 1U);
  EXPECT_EQ(report.invalid, 2U);
  EXPECT_EQ(report.landmarks, 1U);
  filter.predict((Vector6d() << 10.0, 0, 0, 0, 0, 0).finished(), 1.0, Matrix6d::Zero()); // drives past it
  const FrameReport behind = filter.update(rig, {10, {{1, good}}});
  EXPECT_EQ(behind.used, 0U);
  EXPECT_EQ(behind.rejected, 1U);
}

TEST(JointEkf, TakesPixelsThatNoImageHasForInvalid) {
  const PaperConfig config = sharpConfig(PaperMode::kSlam);
  const StereoRig rig = exampleRig();
  JointEkf filter(config);
  LandmarkMapper mapper(config);
  const StereoPixels good = rig.camera.project({0.5, 0.2, 8.0});
  filter.update(rig, {0, {{1, good}}});
  mapper.update(rig, SE3(), {0, {{1, good}}});
  Stamp stamp = 0;
  for (const double bad : {1.001e6, -1.001e6, 1e200, -1e308}) {
    for (int i = 0; i < 4; ++i) {
      StereoFrame frame{++stamp, {{1, good}, {2, good}}};
      for (auto& feature : frame.features) feature.pixels[i] = bad;
      for (const FrameReport& report : {filter.update(rig, frame), mapper.update(rig, SE3(), frame)}) {
        EXPECT_EQ(report.invalid, 2U) << bad;
        EXPECT_EQ(report.used, 0U) << bad;
        EXPECT_EQ(report.landmarks, 1U) << bad;
      }
    }
  }
  EXPECT_EQ(distance(filter.imuTWorld().matrix(), Eigen::Matrix4d::Identity()), 0.0);
}

TEST(JointEkf, AFrameWithoutAFiniteCorrectionIsRejectedAndChangesNothing) {
  const StereoRig rig = exampleRig();
  const StereoPixels known = rig.camera.project({0.5, 0.2, 8.0}),
                     fresh = rig.camera.project({-1.0, 0.1, 6.0});
  PaperConfig vague = sharpConfig(PaperMode::kSlam);
  vague.prior_landmark_variance = 1e308; // times the square of a derivative it overflows
  JointEkf by_landmark(vague), by_pose(sharpConfig(PaperMode::kSlam));
  by_landmark.update(rig, {0, {{1, known}}});
  by_pose.update(rig, {0, {{1, known}}});
  by_pose.predict(Vector6d::Zero(), 1.0, 1e306 * Matrix6d::Identity());
  for (JointEkf* filter : {&by_landmark, &by_pose}) {
    const Eigen::MatrixXd covariance = filter->covariance();
    const Eigen::Matrix4d pose = filter->imuTWorld().matrix();
    const Eigen::Vector3d position = filter->landmarks()[0].position;
    const FrameReport report =
        filter->update(rig, {1, {{1, known + StereoPixels(1.0, 2.0, 0.5, 2.0)}, {2, fresh}}});
    EXPECT_TRUE(report.frame_rejected);
    EXPECT_EQ(report.used, 0U);
    EXPECT_EQ(report.initialised, 0U);
    EXPECT_EQ(report.landmarks, 1U);
    EXPECT_EQ(report.nis_dof, 0U);
    ASSERT_EQ(filter->covariance().rows(), covariance.rows());
    EXPECT_TRUE(filter->covariance() == covariance);
    EXPECT_TRUE(filter->imuTWorld().matrix() == pose);
    EXPECT_TRUE(filter->landmarks()[0].position == position);
  }
}

TEST(JointEkf, CovarianceStaysSymmetricAndPositiveDefiniteOverHundredsOfUpdates) {
  PaperConfig config = sharpConfig(PaperMode::kSlam);
  config.pixel_noise = 0.01; // sharp observations of vague landmarks: the hard case for the subtraction
  config.prior_landmark_variance = 300.0;
  const StereoRig rig = exampleRig();
  Street street(8, 12);
  JointEkf filter(config);
  for (int k = 0; k < 600; ++k) {
    filter.update(rig, street.frame(k, SE3(), 0.05));
    filter.predict(Vector6d::Zero(), kStep, 1e-6 * Matrix6d::Identity());
    if (k % 50 == 49) {
      const Eigen::MatrixXd P = filter.covariance();
      ASSERT_GT(P.rows(), 15);
      ASSERT_EQ(distance(P, P.transpose()), 0.0) << k;
      ASSERT_TRUE(isPositive(P)) << k;
    }
  }
  EXPECT_TRUE(so3::isRotation(filter.imuTWorld().rotation(), 1e-14));
}

} // namespace
} // namespace vi_ekf_slam::paper

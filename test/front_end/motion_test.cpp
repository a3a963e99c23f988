#include <gtest/gtest.h>

#include <cmath>

#include "slanted_plane.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/front_end/ego_motion.hpp"
#include "vi_ekf_slam/front_end/motion_predictor.hpp"

namespace vi_ekf_slam {
namespace {

/// Of 60 points while the camera moves by `truth`; a third of them are wrong.
std::vector<Displacement> displacedBy(const SE3& truth) {
  cv::RNG random(9);
  std::vector<Displacement> displacements;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d p(random.uniform(-2.0, 2.0), random.uniform(-1.5, 1.5), random.uniform(3.0, 9.0));
    Eigen::Vector2d now = kTestCamera.project(truth * p).head<2>();
    if (i % 3 == 0) now += Eigen::Vector2d(random.uniform(-60.0, 60.0), random.uniform(-60.0, 60.0));
    displacements.push_back({p, now});
  }
  return displacements;
}

TEST(EgoMotion, is_found_beside_a_third_of_wrong_tracks) {
  const SE3 truth(so3::Exp({0.01, -0.03, 0.02}), {0.1, -0.05, -0.4});
  std::vector<Displacement> displacements = displacedBy(truth);
  const auto motion = estimateMotion(kTestCamera, displacements, SE3());
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->inverse() * truth).Log().norm(), 0.02);
  displacements.resize(5);
  EXPECT_FALSE(estimateMotion(kTestCamera, displacements, SE3()));
}

// As at the start of a drive: with nothing found the next pair has no guess either.
TEST(EgoMotion, is_found_without_a_guess_while_the_camera_moves_fast) {
  for (const Eigen::Vector3d& t : {Eigen::Vector3d(0.5, 0.0, 0.0), Eigen::Vector3d(0.0, 0.0, -1.4),
                                   Eigen::Vector3d(-0.3, 0.2, -0.8), Eigen::Vector3d(0.1, 0.0, 0.0)}) {
    const SE3 truth(so3::Exp({0.01, -0.03, 0.02}), t);
    const auto motion =
        estimateMotion(kTestCamera, displacedBy(truth), SE3(truth.rotation(), Eigen::Vector3d::Zero()));
    ASSERT_TRUE(motion) << t.transpose();
    EXPECT_LT((motion->inverse() * truth).Log().norm(), 0.02) << t.transpose();
  }
}

/// What the camera sees of a wall, 4 m away, to the left, and of a board before it that moves by `board` (m).
std::vector<Displacement> displacedBeside(const SE3& truth, const Eigen::Vector3d& board) {
  cv::RNG random(11);
  std::vector<Displacement> displacements;
  for (int i = 0; i < 100; ++i) {
    const bool on_board = i >= 60;
    const double depth = on_board ? 2.0 : random.uniform(3.5, 4.5);
    const double u = on_board ? random.uniform(170.0, 310.0) : random.uniform(10.0, 150.0);
    const Eigen::Vector3d p((u - kTestCamera.cu) / kTestCamera.fu * depth,
                            random.uniform(-0.35, 0.35) * depth, depth);
    const Eigen::Vector2d noise(random.gaussian(0.1), random.gaussian(0.1));
    const Eigen::Vector3d now = truth * (on_board ? p + board : p);
    displacements.push_back({p, kTestCamera.project(now).head<2>() + noise});
  }
  return displacements;
}

// Both would fit if the camera turned.
TEST(EgoMotion, does_not_turn_against_the_gyro_with_a_board_that_moves) {
  const SE3 truth(so3::Exp({0.004, -0.01, 0.006}), {0.055, -0.014, 0.008});
  const SE3 guess(truth.rotation(), Eigen::Vector3d(0.05, -0.014, 0.006)); // as it moved before
  for (const Eigen::Vector3d& board : {Eigen::Vector3d(0.0, 0.03, 0.0), Eigen::Vector3d(-0.04, 0.0, 0.0)}) {
    const auto displacements = displacedBeside(truth, board);
    const auto motion = estimateMotion(kTestCamera, displacements, guess, guess);
    ASSERT_TRUE(motion);
    EXPECT_LT((motion->inverse() * truth).Log().norm(), 3e-3) << board.transpose();
  }
}

// Its bias, or axes that are not the camera's: what fits without it is right.
TEST(EgoMotion, is_that_of_the_points_where_the_gyro_is_wrong) {
  const SE3 truth(so3::Exp({0.01, -0.03, 0.02}), {0.1, -0.05, -0.4});
  for (const double wrong : {0.0, 0.003, 0.01, 0.03, 0.1}) { // rad
    const SE3 told(so3::Exp({wrong, -wrong, 0.0}) * truth.rotation(), truth.translation());
    const auto motion = estimateMotion(kTestCamera, displacedBy(truth), told, told);
    ASSERT_TRUE(motion) << wrong;
    EXPECT_LT((motion->inverse() * truth).Log().norm(), 0.02) << wrong;
  }
}

// A car ahead that the camera follows moves along its epipolar lines.
TEST(EgoMotion, knows_what_moves_from_what_has_another_disparity) {
  const SE3 ahead(so3::Exp({0.0, 0.02, 0.0}), {0.0, 0.0, -1.0});
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(2.0, -1.0, 8.0), Eigen::Vector3d(-3.0, 0.5, 20.0)}) {
    const Eigen::Vector2d now = kTestCamera.project(ahead * p).head<2>();
    EXPECT_NEAR(0.0, misfit(kTestCamera, {p, now}, ahead), 1e-9);
    const double disparity = kTestCamera.fu * kTestCamera.baseline / p.z();
    for (const double error : {-0.3, 0.3}) { // px
      const double off = misfit(kTestCamera, {p * disparity / (disparity + error), now}, ahead);
      EXPECT_GT(off, 0.0);
      EXPECT_LT(off, 1.02 * std::abs(error));
    }
    const Eigen::Vector2d moved = kTestCamera.project(ahead * (p + Eigen::Vector3d(0.0, 0.0, 1.0))).head<2>();
    EXPECT_GT(misfit(kTestCamera, {p, moved}, ahead), 1.0);
  }
  const Eigen::Vector3d far(0.0, 0.0, 1e6);
  const Eigen::Vector2d beside = kTestCamera.project(ahead * far).head<2>() + Eigen::Vector2d(0.0, 3.0);
  EXPECT_NEAR(3.0, misfit(kTestCamera, {far, beside}, ahead), 1e-3);
  EXPECT_TRUE(std::isinf(misfit(kTestCamera, {{0.0, 0.0, 0.9}, {100.0, 100.0}}, ahead))); // behind it
}

TEST(GyroRotation, integrates_between_samples_and_knows_where_they_end) {
  GyroRotation gyro;
  for (int i = 0; i <= 10; ++i) {
    ImuSample sample;
    sample.stamp = 1'000'000'000 + i * 10'000'000;
    sample.angular_velocity = {0.0, 0.0, 2.0 + 0.1 * i}; // rad/s, linear in time
    gyro.add(sample);
  }
  const auto turned = gyro.between(1'005'000'000, 1'087'000'000);
  ASSERT_TRUE(turned);
  const double from = 0.005, to = 0.087;
  EXPECT_NEAR(2.0 * (to - from) + 5.0 * (to * to - from * from), so3::Log(*turned).z(), 1e-12);
  EXPECT_FALSE(gyro.between(999'000'000, 1'050'000'000));
  EXPECT_FALSE(gyro.between(1'050'000'000, 1'101'000'000));
  gyro.forgetBefore(1'055'000'000);
  EXPECT_TRUE(gyro.between(1'055'000'000, 1'060'000'000));
  ImuSample again;
  again.stamp = 50'000'000; // a bag that loops
  gyro.add(again);
  EXPECT_TRUE(gyro.between(50'000'000, 50'000'000));
  EXPECT_FALSE(gyro.between(1'055'000'000, 1'060'000'000));
}

TEST(MotionPredictor, goes_on_as_before_but_for_the_rotation_that_the_gyro_measured) {
  MotionPredictor predictor;
  EXPECT_TRUE(predictor.predict(0, fromSeconds(0.1)).now_T_before.rotation().isIdentity());
  const SE3 motion(so3::Exp({0.0, 0.1, 0.0}), Eigen::Vector3d(0.0, 0.0, -0.5));
  predictor.learn(motion, {SE3(), false}, 0.1);
  const auto twice = predictor.predict(fromSeconds(1.0), fromSeconds(1.2));
  EXPECT_FALSE(twice.rotation_known);
  EXPECT_TRUE(twice.now_T_before.matrix().isApprox((motion * motion).matrix(), 1e-9));
  const Eigen::Matrix3d cam_R_imu = so3::Exp({0.3, -1.2, 0.5});
  for (int i = 0; i <= 10; ++i) {
    ImuSample sample;
    sample.stamp = fromSeconds(1.0 + 0.02 * i);
    sample.angular_velocity = cam_R_imu.transpose() * Eigen::Vector3d(0.0, 0.0, 2.0);
    predictor.addImu(sample);
  }
  EXPECT_FALSE(predictor.predict(fromSeconds(1.0), fromSeconds(1.2)).rotation_known); // nor its axes
  predictor.setImuRotation(cam_R_imu);
  const auto turned = predictor.predict(fromSeconds(1.0), fromSeconds(1.2));
  EXPECT_TRUE(turned.rotation_known);
  EXPECT_TRUE(turned.now_T_before.rotation().isApprox(so3::Exp({0.0, 0.0, -0.4}), 1e-9));
  EXPECT_TRUE(turned.now_T_before.translation().isApprox(twice.now_T_before.translation()));
  EXPECT_FALSE(predictor.predict(fromSeconds(1.0), fromSeconds(1.3)).rotation_known); // no samples there
  predictor.learn(std::nullopt, {SE3(), false}, 0.1);
  EXPECT_TRUE(predictor.predict(fromSeconds(1.0), fromSeconds(1.2)).now_T_before.translation().isZero());
}

TEST(MotionPredictor, learns_what_the_gyro_is_off_by) {
  MotionPredictor predictor;
  const SE3 predicted(so3::Exp({0.0, 0.1, 0.0}), Eigen::Vector3d(0.0, 0.0, -0.5));
  EXPECT_TRUE(predictor.withoutBias(predicted, 0.1).matrix().isApprox(predicted.matrix()));
  const Eigen::Vector3d bias(0.03, -0.02, 0.05); // rad/s
  cv::RNG random(4);
  for (int k = 0; k < 40; ++k) {
    const Eigen::Vector3d noise(random.gaussian(1e-3), random.gaussian(1e-3), random.gaussian(1e-3));
    const SE3 moved(so3::Exp(0.1 * bias + noise) * predicted.rotation(), predicted.translation());
    predictor.learn(moved, {predicted, true}, 0.1);
    predictor.learn(SE3(), {predicted, false}, 0.1); // not of the gyro
    predictor.learn(std::nullopt, {predicted, true}, 0.1);
  }
  const SE3 without = predictor.withoutBias(predicted, 0.2);
  EXPECT_LT(so3::Log(without.rotation() * (so3::Exp(0.2 * bias) * predicted.rotation()).transpose()).norm(),
            1e-3);
  EXPECT_TRUE(without.translation().isApprox(predicted.translation()));
}

} // namespace
} // namespace vi_ekf_slam

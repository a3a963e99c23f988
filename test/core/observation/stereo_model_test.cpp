#include "vi_ekf_slam/core/observation/stereo_model.hpp"

#include <cmath>
#include <limits>
#include <random>

#include "../filter/states.hpp"
#include "vi_ekf_slam/core/observation/inverse_depth.hpp"

namespace vi_ekf_slam::test {
namespace {

/// (u_left, v, u_right) of the i-th point in `state`, with the baseline that `state` has.
Eigen::Vector3d predicted(const Scene& scene, const State& state, std::size_t i) {
  StereoRig rig = exampleRig();
  if (scene.scale) rig.camera.baseline *= 1.0 + state.x[scene.filter.rowOf(*scene.scale)];
  const Eigen::Vector3d x = state.x.segment<3>(scene.filter.rowOf(scene.points[i]));
  const StereoPixels z = rig.camera.project(rig.cam_T_imu * state.pose.inverse() * x);
  return {z[0], 0.5 * (z[1] + z[3]), z[2]};
}

TEST(StereoModelTest, ObservesWhereThePointIsSeenAndByItsDerivatives) {
  Random random(11);
  for (const double scale_sigma : {0.0, 0.02}) {
    const Scene scene = busyScene(random, 3, scale_sigma);
    const State estimate = stateOf(scene.filter);
    const Variables& variables = scene.filter.variables();
    for (std::size_t i = 0; i < 3; ++i) {
      const auto seen = scene.model().observe(scene.filter, scene.points[i], {700.0, 200.0, 650.0, 201.0});
      ASSERT_TRUE(seen);
      EXPECT_LT(distance(Eigen::Vector3d(seen->residual()),
                         Eigen::Vector3d(700.0, 200.5, 650.0) - predicted(scene, estimate, i)),
                1e-9);
      EXPECT_EQ(distance(Eigen::Matrix3d(seen->noise()), scene.model().noise()), 0.0);
      const Eigen::MatrixXd H = derivative(
          [&](const Eigen::VectorXd& error) -> Eigen::VectorXd {
            return predicted(scene, truthAt(variables, estimate, error), i);
          },
          scene.filter.rows());
      EXPECT_LT(relativeDistance(denseOf(*seen, scene.filter.rows()), H), 1e-6) << scale_sigma;
      EXPECT_EQ(seen->termCount(), scale_sigma > 0.0 ? 2u : 1u);
    }
  }
}

TEST(StereoModelTest, HasTheNoiseOfFourPixels) {
  Random random(12);
  const Eigen::Matrix3d expected = Eigen::Vector3d(0.49, 0.245, 0.49).asDiagonal();
  EXPECT_LT(distance(coreScene(random).model().noise(), expected), 1e-15);
}

TEST(StereoModelTest, TriangulatesWithinItsRange) {
  Random random(13);
  for (const double scale_sigma : {0.0, 0.02}) {
    Scene scene = busyScene(random, 1, scale_sigma);
    const StereoModel model = scene.model();
    StereoCamera camera = exampleRig().camera;
    if (scene.scale) camera.baseline *= 1.02;
    const auto pixels = [&](double depth) {
      return camera.project(Eigen::Vector3d(0.1 * depth, -0.05 * depth, depth));
    };
    EXPECT_FALSE(model.triangulate(scene.filter, pixels(0.4)));
    EXPECT_FALSE(model.triangulate(scene.filter, pixels(221.0)));
    // Of the pixels that have p - (-s, 0, s, 0) = pixels(20) with s = sigma^2 / disparity(p).
    const double disparity = pixels(20.0)[0] - pixels(20.0)[2];
    const double shift = 0.49 / (0.5 * (disparity + std::sqrt(disparity * disparity + 8.0 * 0.49)));
    const auto found = model.triangulate(scene.filter, pixels(20.0) + StereoPixels(shift, 0.0, -shift, 0.0));
    ASSERT_TRUE(found);
    EXPECT_LT(distance(found->position, scene.worldTCam() * Eigen::Vector3d(2.0, -1.0, 20.0)), 1e-9);
    EXPECT_EQ(found->by.isNone(), scale_sigma == 0.0);
    // Seen in pixels the new point is as uncertain as the pixels are, whatever the scale is.
    const Handle point = scene.filter.augment(Chart::kPoint, found->position, found->noise, found->by);
    const auto seen = model.observe(scene.filter, point, pixels(20.0));
    ASSERT_TRUE(seen);
    EXPECT_LT(seen->residual().norm(), 1e-9);
    const Innovation in(scene.filter.covariance(), {*seen});
    EXPECT_LT(distance(Eigen::Matrix3d(in.S(0, 0)), 2.0 * model.noise()), 1e-8);
  }
}

/// How far beyond 1 m of driving ahead, which is known, points put it that start from noisy pixels; their
/// mean in units of its standard deviation. `start`: where they start from.
double biasOfADistance(const StereoModel& model, const StereoModel& start) {
  const StereoRig rig = exampleRig();
  const Eigen::Vector3d ahead(0.0, 0.0, 1.0); // of the camera
  const Matrix6d known = 1e-12 * Matrix6d::Identity();
  const Filter before(SE3(), known);
  Filter after(rig.cam_T_imu.inverse() * SE3(Eigen::Matrix3d::Identity(), ahead) * rig.cam_T_imu, known);
  after.closeCore();
  std::mt19937 random(17);
  std::normal_distribution<double> noise(0.0, 0.7);
  const auto seen = [&](const Eigen::Vector3d& q) {
    StereoPixels pixels = rig.camera.project(q);
    for (int i = 0; i < 4; ++i) pixels[i] += noise(random);
    return pixels;
  };
  double information = 0.0, weighted = 0.0;
  for (int i = 0; i < 160000; ++i) {
    std::uniform_real_distribution<double> side(-0.5, 0.5), depth(15.0, 60.0);
    const double z = depth(random);
    const Eigen::Vector3d q(side(random) * z, side(random) * z, z);
    const StereoPixels first = seen(q), second = seen(q - ahead);
    const auto at = start.triangulate(before, first);
    const auto with = model.triangulate(before, first);
    if (!at || !with) continue;
    const Handle point = after.augment(Chart::kPoint, at->position, with->noise);
    const auto measured = model.observe(after, point, second);
    const Eigen::Matrix3d H = measured->term(0).H;
    const Eigen::Vector3d moved = -H * rig.cam_T_imu.rotation().transpose() * ahead;
    const Eigen::Vector3d weight = Innovation(after.covariance(), {*measured}).S(0, 0).inverse() * moved;
    information += weight.dot(moved);
    weighted += weight.dot(Eigen::Vector3d(measured->residual()));
    after.remove(point);
  }
  return weighted / std::sqrt(information);
}

TEST(StereoModelTest, TellsADistanceWithoutBiasByPointsOfNoisyDepth) {
  const auto modelOf = [](double pixel_sigma) {
    StereoModel::Options options;
    options.pixel_sigma = pixel_sigma;
    return StereoModel(exampleRig(), options);
  };
  EXPECT_LT(std::abs(biasOfADistance(modelOf(0.7), modelOf(0.7))), 3.0);
  EXPECT_LT(biasOfADistance(modelOf(0.7), modelOf(1e-9)), -6.0) << "started at their pixels";
}

TEST(StereoModelTest, DoesNotSeeBehindItselfNorTooNear) {
  Random random(14);
  Scene scene = busyScene(random, 1);
  for (const double z : {-5.0, 0.0, 0.49, 0.51}) {
    const Handle point = scene.filter.augment(Chart::kPoint, scene.worldTCam() * Eigen::Vector3d(0.1, 0.1, z),
                                              Eigen::Matrix3d::Identity());
    const bool seen = scene.model().observe(scene.filter, point, {600, 180, 500, 180}).has_value();
    EXPECT_EQ(seen, z > 0.5) << z;
  }
}

TEST(StereoModelTest, UsesPixelsOfAPointBeforeThePairAlone) {
  Random random(15);
  const Scene scene = coreScene(random);
  const StereoModel model = scene.model();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(model.isUsable({600.0, 180.0, 590.0, 181.0}));
  for (const double disparity : {0.5, -2.0}) {
    const StereoPixels far(600.0, 180.0, 600.0 - disparity, 180.0);
    EXPECT_TRUE(model.isUsable(far)) << "the noise of a far one";
    EXPECT_FALSE(model.triangulate(scene.filter, far)) << "no start";
  }
  EXPECT_FALSE(model.isUsable({600.0, 180.0, 610.0, 180.0})) << "behind";
  EXPECT_FALSE(model.isUsable({600.0, 180.0, 590.0, 184.5})) << "rows apart";
  EXPECT_FALSE(model.isUsable({nan, 180.0, 590.0, 180.0}));
  EXPECT_FALSE(model.isUsable({2e6, 180.0, 590.0, 180.0}));
}

TEST(StereoModelTest, LeavesTheCovarianceInInverseDepthWhenAPointMoves) {
  Random random(16);
  for (int run = 0; run < 20; ++run) {
    const Scene start = busyScene(random, 4);
    auto with_residual = start.seen(random, 3.0);
    std::vector<LinearMeasurement> without;
    for (const LinearMeasurement& z : with_residual) {
      without.emplace_back(Eigen::Vector3d::Zero(), z.noise());
      for (const auto& term : z) without.back().by(term.column, term.H);
    }
    Scene still = start, with = start;
    const PointChart chart = start.model().inverseDepthChart(start.filter);
    correct(still.filter, without, chart);
    correct(with.filter, with_residual, chart);
    expectCovariance(with.filter.covariance());
    // The covariance of all, with (x/z, y/z, 1/z) as the corrected camera sees them in place of the points'
    // errors, must not have changed; and the pose's error is the same one, about another position.
    const SE3 cam_T_world = exampleRig().cam_T_imu * with.filter.pose().inverse();
    const auto inInverseDepth = [&](const Scene& scene) {
      Eigen::MatrixXd A = Eigen::MatrixXd::Identity(scene.filter.rows(), scene.filter.rows());
      A.block<3, 3>(0, 3) = so3::hat(scene.filter.pose().translation() - start.filter.pose().translation());
      for (const Handle point : scene.points) {
        const Eigen::Index row = scene.filter.rowOf(point);
        A.block<3, 3>(row, row) =
            InverseDepth::jacobian(cam_T_world * scene.filter.variables().point(point)) *
            cam_T_world.rotation();
      }
      return Eigen::MatrixXd(A * scene.filter.covariance() * A.transpose());
    };
    EXPECT_GT(distance(with.filter.variables().point(with.points[0]),
                       still.filter.variables().point(still.points[0])),
              1e-3);
    EXPECT_LT(distance(inInverseDepth(with), inInverseDepth(still)), 1e-12);
  }
}

// Where the tilt of the world was not known. A camera that turns with all that it sees sees nothing new.
TEST(StereoModelTest, LeavesThePictureAloneWhenACorrectionTurnsTheWorld) {
  Random random(17);
  for (const double angle : {0.02, 0.3, 1.0}) {
    Scene scene = busyScene(random, 10);
    Variables variables = scene.filter.variables();
    const SE3 before = variables.pose();
    std::vector<Eigen::Vector3d> seen;
    for (const Handle point : scene.points) seen.push_back(before.inverse() * variables.point(point));
    Eigen::VectorXd error = Eigen::VectorXd::Zero(variables.rows());
    error.segment<3>(3) = angle * Eigen::Vector3d(0.6, -0.8, 0.0);
    const auto reexpressed =
        variables.retract(error, variables.rows(), scene.model().inverseDepthChart(scene.filter));
    const Eigen::Matrix3d turn = so3::Exp(error.segment<3>(3));
    EXPECT_LT(distance(variables.pose().rotation(), turn * before.rotation()), 1e-12);
    for (std::size_t i = 0; i < seen.size(); ++i)
      EXPECT_LT(distance(variables.pose().inverse() * variables.point(scene.points[i]), seen[i]),
                1e-9 * seen[i].norm())
          << angle;
    for (const auto& [row, M, N] : reexpressed) EXPECT_LT(distance(M, turn), 1e-9) << angle;
  }
}

} // namespace
} // namespace vi_ekf_slam::test

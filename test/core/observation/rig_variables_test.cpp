#include "vi_ekf_slam/core/observation/rig_variables.hpp"

#include "../filter/states.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kOffset = 0.02; // s, as it is estimated, that was part of the frame's stamp

/// Nothing of the calibration is known well.
RigVariables::Options unknownRig() {
  return {Eigen::Vector3d::Constant(0.02), Eigen::Vector3d::Constant(0.03), 0.02, 0.02, 0.01, {}};
}

Scene unknownScene(Random& random, std::size_t points) {
  Scene scene = busyScene(random, points, unknownRig());
  const auto set = [&](const char* name, const Eigen::VectorXd& mean) {
    scene.filter.setMean(scene.filter.variables().find(name).value(), mean);
  };
  set("camera_rotation", 0.03 * random.vector<3>(-1.0, 1.0));
  set("camera_translation", 0.05 * random.vector<3>(-1.0, 1.0));
  set("camera_time_offset", Eigen::VectorXd::Constant(1, kOffset));
  return scene;
}

Vector6d twistOf(const Scene& scene) {
  return scene.filter.variables().mean(handleOf(scene.filter, ConstantTwist::kTwist));
}

StereoModel modelOf(const Scene& scene) {
  StereoModel model = scene.model();
  model.beginFrame(kOffset, twistOf(scene));
  return model;
}

/// (u_left, v, u_right) of a point in `state`, of which body and rig move as it says.
Eigen::Vector3d predicted(const Scene& scene, const State& state, Handle point, const Vector6d& twist) {
  const auto part = [&](const char* name) {
    const Handle handle = scene.filter.variables().find(name).value();
    return state.x.segment(scene.filter.rowOf(handle), scene.filter.variables().sizeOf(handle)).eval();
  };
  StereoCamera camera = exampleRig().camera;
  camera.baseline *= 1.0 + part("scale")[0];
  const SE3 given = exampleRig().cam_T_imu;
  const SE3 cam_T_imu(so3::Exp(part("camera_rotation")) * given.rotation(),
                      given.translation() + part("camera_translation"));
  const double ahead = part("camera_time_offset")[0] - kOffset;
  const SE3 world_T_imu = state.pose * SE3(so3::Exp(ahead * twist.tail<3>()), ahead * twist.head<3>());
  const Eigen::Vector3d x = state.x.segment<3>(scene.filter.rowOf(point));
  const StereoPixels z = camera.project(cam_T_imu * world_T_imu.inverse() * x);
  return {z[0], 0.5 * (z[1] + z[3]), z[2]};
}

TEST(RigVariablesTest, AreOfTheCoreWhereTheyAreNotKnown) {
  Random random(1);
  const Scene known = coreScene(random), unknown = coreScene(random, unknownRig());
  EXPECT_TRUE(RigVariables(known.filter.variables()).isNone());
  EXPECT_EQ(unknown.filter.coreRows() - known.filter.coreRows(), 8);
  const RigVariables variables(unknown.filter.variables());
  EXPECT_EQ(variables.size(), 8);
  EXPECT_EQ(variables.timeOffset(unknown.filter), 0.01);
  const RigEstimate e = variables.estimate(unknown.filter, exampleRig(), 0.0);
  EXPECT_LT((e.rotation_sigma.array() - 0.02).abs().maxCoeff(), 1e-12);
  EXPECT_LT((e.translation_sigma.array() - 0.03).abs().maxCoeff(), 1e-12);
  EXPECT_NEAR(e.time_offset_sigma, 0.02, 1e-12);
  EXPECT_NEAR(e.baseline_sigma, 0.02 * exampleRig().camera.baseline, 1e-12);
}

TEST(RigVariablesTest, AreObservedByTheirDerivatives) {
  Random random(2);
  for (int drawn = 0; drawn < 10; ++drawn) {
    const Scene scene = unknownScene(random, 2);
    const StereoModel model = modelOf(scene);
    const State estimate = stateOf(scene.filter);
    const Vector6d twist = twistOf(scene);
    for (const Handle point : scene.points) {
      const auto seen = model.observe(scene.filter, point, {700.0, 200.0, 650.0, 201.0});
      ASSERT_TRUE(seen);
      const Eigen::Vector3d z(700.0, 200.5, 650.0);
      EXPECT_LT(distance(Eigen::Vector3d(seen->residual()), z - predicted(scene, estimate, point, twist)),
                1e-8);
      const Eigen::MatrixXd H = derivative(
          [&](const Eigen::VectorXd& error) -> Eigen::VectorXd {
            return predicted(scene, truthAt(scene.filter.variables(), estimate, 0.1 * error), point, twist);
          },
          scene.filter.rows());
      EXPECT_LT(relativeDistance(denseOf(*seen, scene.filter.rows()), 10.0 * H), 1e-6);
    }
  }
}

// Seen in pixels a new point is as uncertain as the pixels are, whatever the calibration is.
TEST(RigVariablesTest, AreInWhatIsTriangulated) {
  Random random(3);
  for (int drawn = 0; drawn < 10; ++drawn) {
    Scene scene = unknownScene(random, 1);
    const StereoModel model = modelOf(scene);
    const StereoPixels pixels(700.0, 200.0, 660.0, 200.0);
    const auto found = model.triangulate(scene.filter, pixels);
    ASSERT_TRUE(found);
    const Handle point = scene.filter.augment(Chart::kPoint, found->position, found->noise, found->by);
    const auto seen = model.observe(scene.filter, point, pixels);
    ASSERT_TRUE(seen);
    const Innovation in(scene.filter.covariance(), {*seen});
    EXPECT_LT(distance(Eigen::Matrix3d(in.S(0, 0)), 2.0 * model.noise()), 1e-6);
  }
}

/// What no picture of the points tells: any error of the calibration r with the points moved to where it has
/// them, y = -R^T Q r.
Eigen::MatrixXd unseenBy(const Scene& scene, const StereoModel& model) {
  const RigVariables& rig = model.variables();
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(scene.filter.rows(), rig.size());
  N.middleRows(rig.row(scene.filter), rig.size()).setIdentity();
  const SE3 cam_T_world = model.camTWorld(scene.filter);
  const auto Q = rig.pointJacobian(scene.filter, exampleRig().cam_T_imu, twistOf(scene));
  for (const Handle point : scene.points)
    N.middleRows<3>(scene.filter.rowOf(point)) =
        -(cam_T_world.rotation().transpose() * Q(cam_T_world * scene.filter.variables().point(point)));
  return N;
}

/// The way so far is as long as the baseline has it.
void makeWayUnknown(Scene& scene, const Eigen::Vector3d& way) {
  scene.filter.settle();
  Eigen::MatrixXd T = Eigen::MatrixXd::Identity(scene.filter.rows(), scene.filter.rows());
  T.block<3, 1>(0, scene.filter.rowOf(scene.scale.value())) = way;
  const Eigen::MatrixXd P = T * scene.filter.covariance() * T.transpose();
  scene.filter.setCoreCovariance(0.5 * (P + P.transpose()));
}

// One picture tells nothing of the calibration, however much it corrects the points' depths and, with the
// baseline, the length of the way so far.
TEST(RigVariablesTest, AreNotLearnedFromOnePicture) {
  Random random(4);
  for (int drawn = 0; drawn < 20; ++drawn) {
    Scene scene = unknownScene(random, 0);
    if (drawn >= 10) makeWayUnknown(scene, {40.0, 10.0, 1.0});
    for (int i = 0; i < 10; ++i) scene.addPoint(random, 1.0);
    const StereoModel model = modelOf(scene);
    std::vector<LinearMeasurement> all;
    for (const Handle point : scene.points) {
      const Eigen::Vector3d q = model.camTWorld(scene.filter) * scene.filter.variables().point(point);
      const StereoPixels noise = 2.0 * random.vector<4>(-1.0, 1.0);
      const auto z = model.observe(scene.filter, point, exampleRig().camera.project(q) + noise);
      ASSERT_TRUE(z);
      EXPECT_LT((denseOf(*z, scene.filter.rows()) * unseenBy(scene, model)).norm(), 1e-9);
      all.push_back(*z);
    }
    const Eigen::MatrixXd before = informationOf(scene.filter.covariance(), unseenBy(scene, model));
    Innovation in(scene.filter.covariance(), all);
    ASSERT_TRUE(in.factorise());
    ASSERT_TRUE(scene.filter.correct(in, model.inverseDepthChart(scene.filter, in.error())));
    const Eigen::MatrixXd after = informationOf(scene.filter.covariance(), unseenBy(scene, model));
    EXPECT_LT(relativeDistance(after, before), 0.02) << before << "\n\n" << after;
    expectCovariance(scene.filter.covariance());
  }
}

} // namespace
} // namespace vi_ekf_slam::test

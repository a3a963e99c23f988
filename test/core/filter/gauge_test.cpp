// How the whole world is shifted or turned is told by nothing: dp = delta + phi x (p - c), theta = phi, and
// no other error, is unobservable, exactly.

#include "states.hpp"
#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/core/health/recovery.hpp"
#include "vi_ekf_slam/core/loops/fuse_matches.hpp"
#include "vi_ekf_slam/core/observation/body_twist.hpp"
#include "vi_ekf_slam/core/tracking/track_slip.hpp"

namespace vi_ekf_slam::test {
namespace {

/// Rows of an inactive point in the joint covariance, and where its error was converted.
Eigen::MatrixXd jointGaugeOf(Filter filter) {
  filter.settleInactive();
  const Eigen::Index n = filter.rows();
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(n + filter.inactive().covariance().rows(), 6);
  N.topRows(n) = gaugeOf(filter);
  for (std::size_t i = 0; i < filter.inactive().variables().size(); ++i) {
    const Eigen::Vector3d x = filter.inactive().variables()[i].linearised;
    N.middleRows<3>(n + filter.inactive().rowOf(i)) << Eigen::Matrix3d::Identity(), -so3::hat(x);
  }
  return N;
}

/// What is known of the gauge, in units that make its six directions alike.
Eigen::MatrixXd knownOf(const Filter& filter) { return informationOf(jointOf(filter), jointGaugeOf(filter)); }

void expectNotMore(const Eigen::MatrixXd& now, const Eigen::MatrixXd& before, double rounding) {
  Eigen::MatrixXd less = before - now;
  const Eigen::VectorXd scale = before.diagonal().cwiseSqrt().cwiseInverse();
  less = (scale.asDiagonal() * less * scale.asDiagonal()).eval();
  less = (0.5 * (less + less.transpose())).eval();
  less.diagonal().array() += rounding;
  EXPECT_EQ(Eigen::LLT<Eigen::MatrixXd>(less).info(), Eigen::Success) << before << "\n\n" << now;
}

TEST(Gauge, NoMeasurementTellsIt) {
  Random random(1);
  for (int run = 0; run < 20; ++run) {
    const Scene scene = busyScene(random, 4, run % 2 == 0 ? 0.02 : 0.0);
    const Eigen::MatrixXd N = gaugeOf(scene.filter);
    std::vector<LinearMeasurement> all = scene.seen(random, 3.0);
    ASSERT_EQ(all.size(), 4u);
    for (const Eigen::Index axis : {0, 3})
      all.push_back(measureTwist(scene.filter, handleOf(scene.filter, ConstantTwist::kTwist),
                                 handleOf(scene.filter, ConstantTwist::kBias), axis,
                                 random.vector<3>(-1.0, 1.0), Eigen::Matrix3d::Identity()));
    all.push_back(measureStandstill(scene.filter, handleOf(scene.filter, ConstantTwist::kTwist), 0.1));
    for (const LinearMeasurement& z : all)
      EXPECT_EQ((denseOf(z, scene.filter.rows()) * N).cwiseAbs().maxCoeff(), 0.0);
  }
}

// The same without the Jacobians: the world shifted by 30 m and turned by 2 rad looks as it did.
TEST(Gauge, NoPixelMovesWhenTheWorldDoes) {
  Random random(2);
  const Scene scene = busyScene(random, 6, 0.02);
  const State estimate = stateOf(scene.filter);
  const Eigen::Vector3d phi(0.2, -0.3, 2.0), delta(30.0, -5.0, 2.0);
  Eigen::VectorXd error = Eigen::VectorXd::Zero(scene.filter.rows());
  error.head<3>() = delta + so3::Exp(phi) * estimate.pose.translation() - estimate.pose.translation();
  error.segment<3>(3) = phi;
  const State truth = truthAt(scene.filter.variables(), estimate, error);
  const SE3 world(so3::Exp(phi), delta);
  EXPECT_LT(distance(truth.pose.matrix(), (world * estimate.pose).matrix()), 1e-12);
  for (const Handle point : scene.points) {
    const Eigen::Index row = scene.filter.rowOf(point);
    const Eigen::Vector3d x = truth.x.segment<3>(row);
    EXPECT_LT(distance(x, world * Eigen::Vector3d(estimate.x.segment<3>(row))), 1e-12);
    const SE3 cam_T_world = exampleRig().cam_T_imu * truth.pose.inverse();
    StereoCamera camera = exampleRig().camera;
    camera.baseline *= 1.0 + scene.filter.variables().mean(*scene.scale)[0];
    EXPECT_LT(distance(camera.project(cam_T_world * x), scene.expectedPixels(point)), 1e-9);
  }
}

TEST(Gauge, IsTransportedAndNeverLearned) {
  Random random(3);
  for (const bool noise : {false, true}) {
    Scene scene = busyScene(random, 8, 0.02);
    if (!noise) {
      scene.motion = ConstantTwist(withoutNoise(noisyMotion()));
      Filter same(SE3{}, Matrix6d::Identity());
      scene.motion.addTo(same); // the same handles
    }
    const Eigen::MatrixXd first = knownOf(scene.filter);
    Eigen::MatrixXd before = first;
    for (int frame = 0; frame < 100; ++frame) {
      for (int sample = 0; sample < 3; ++sample) {
        scene.motion.propagate(scene.filter, 0.01);
        ImuSample gyro;
        gyro.angular_velocity = random.vector<3>(-0.1, 0.3);
        scene.motion.process(scene.filter, gyro);
        VelocitySample velocity;
        velocity.linear_velocity = Eigen::Vector3d(5.0, 0.0, 0.0) + random.vector<3>(-1.0, 1.0);
        scene.filter.correct(scene.motion.measure(scene.filter, velocity));
      }
      scene.filter.settle();
      const auto all = scene.seen(random, 2.0);
      if (!all.empty())
        correct(scene.filter, all,
                frame % 2 == 0 ? scene.model().inverseDepthChart(scene.filter) : PointChart());
      const Eigen::MatrixXd now = knownOf(scene.filter);
      if (noise)
        expectNotMore(now, before, 1e-6);
      else
        EXPECT_LT(relativeDistance(now, first), 1e-6) << frame;
      if (HasFailure()) FAIL() << "frame " << frame << (noise ? " with" : " without") << " noise";
      before = now;
    }
  }
}

TEST(Gauge, IsNotLearnedFromWhatIsInactiveNorFromDuplicatesNorByARecovery) {
  Random random(4);
  Scene scene = busyScene(random, 8, 0.02);
  std::vector<Handle> away;
  Eigen::MatrixXd before = knownOf(scene.filter);
  const auto check = [&](const char* what, int frame) {
    const Eigen::MatrixXd now = knownOf(scene.filter);
    expectNotMore(now, before, 1e-5);
    EXPECT_FALSE(HasFailure()) << what << ", frame " << frame;
    before = now;
  };
  for (int frame = 0; frame < 60 && !HasFailure(); ++frame) {
    scene.motion.propagate(scene.filter, 0.05);
    ImuSample gyro;
    gyro.angular_velocity = {0.0, 0.0, 0.4};
    scene.motion.process(scene.filter, gyro);
    scene.filter.settle();
    correct(scene.filter, scene.seen(random, 1.0));
    check("update", frame);
    if (frame % 3 == 0) {
      scene.filter.deactivate(scene.points.front());
      away.push_back(scene.points.front());
      scene.points.erase(scene.points.begin());
      scene.addPoint(random);
      check("deactivation", frame);
    }
    if (frame % 10 == 9) {
      const Handle back = away[static_cast<std::size_t>(frame) % away.size()];
      scene.filter.activate({back});
      check("activation", frame);
      const Handle twin = scene.filter.augment(
          Chart::kPoint, scene.filter.variables().point(back) + random.vector<3>(-0.1, 0.1),
          0.05 * Eigen::Matrix3d::Identity());
      EXPECT_EQ(countTrue(fuseDuplicates(scene.filter, {{twin, back}}, 1, 1e-3)), 1u);
      check("duplicates", frame);
      scene.filter.remove(twin);
      scene.filter.deactivate(back);
      check("deactivation again", frame);
    }
    if (frame == 30) {
      resetPose(scene.filter, SE3::Exp(random.vector<6>(-0.2, 0.2)), 0.01 * random.covariance<6>());
      check("pose reset", frame);
    }
  }
}

// Points that move by what the core knows, seen again and again, some of them inactive: they tell what moves
// them, and not where the world is.
TEST(Gauge, IsNotLearnedWhereACoreVariableMovesTheRest) {
  Random random(7);
  Scene scene = busyScene(random, 8, 0.02);
  Eigen::MatrixXd before = knownOf(scene.filter);
  for (int frame = 0; frame < 60 && !HasFailure(); ++frame) {
    scene.motion.propagate(scene.filter, 0.05);
    if (frame % 2 == 0) scene.filter.settle(); // in the middle of a period, or between two
    scene.filter.moveRest(*scene.scale,
                          0.3 * randomMatrix(random, scene.filter.rows() - scene.filter.coreRows(), 1));
    expectNotMore(knownOf(scene.filter), before, 1e-6);
    correct(scene.filter, scene.seen(random, 1.0));
    if (frame % 5 == 4) {
      scene.filter.deactivate(scene.points.front());
      scene.points.erase(scene.points.begin());
      scene.addPoint(random);
    }
    const Eigen::MatrixXd now = knownOf(scene.filter);
    expectNotMore(now, before, 1e-6);
    EXPECT_FALSE(HasFailure()) << "frame " << frame;
    before = now;
  }
}

TEST(Gauge, IsNotLearnedFromTracksThatSlip) {
  Random random(8);
  for (const double length : {1.0, 1e6}) { // slips that change, and that stay
    TrackSlip slip({0.02, 1e-3, length});
    Filter filter({so3::Exp({0.1, -0.2, 0.3}), {30.0, -20.0, 5.0}}, 0.01 * random.covariance<6>());
    ConstantTwist motion(noisyMotion());
    motion.addTo(filter);
    slip.addTo(filter);
    filter.closeCore();
    filter.setMean(handleOf(filter, ConstantTwist::kTwist),
                   (Vector6d() << 8.0, 0.3, -0.2, 0.05, -0.1, 0.4).finished());
    Scene scene{filter, motion, {}, {}};
    LandmarkMap map({});
    for (int i = 0; i < 8; ++i) {
      scene.addPoint(random);
      map.add({static_cast<FeatureId>(i), scene.points.back(), 1, 0, 0, false});
    }
    Eigen::MatrixXd before = knownOf(scene.filter);
    for (int frame = 0; frame < 20 && !HasFailure(); ++frame) {
      const Eigen::Vector3d start = scene.filter.pose().translation();
      scene.motion.propagate(scene.filter, 0.05);
      const Eigen::Vector3d displacement = scene.filter.pose().translation() - start;
      slip.propagate(scene.filter, displacement.norm());
      slip.apply(scene.filter, map, displacement);
      scene.filter.settle();
      const auto all = scene.seen(random, 1.0);
      for (const LinearMeasurement& z : all)
        EXPECT_EQ((denseOf(z, scene.filter.rows()) * gaugeOf(scene.filter)).cwiseAbs().maxCoeff(), 0.0);
      if (!all.empty()) correct(scene.filter, all);
      const Eigen::MatrixXd now = knownOf(scene.filter);
      expectNotMore(now, before, 1e-6);
      EXPECT_FALSE(HasFailure()) << "length " << length << ", frame " << frame;
      before = now;
    }
  }
}

/// A filter of an uncertain pose with points that are known from it, and what a measurement of the pose
/// tells: it moves the whole world.
struct WorldMoves {
  explicit WorldMoves(unsigned seed) : random(seed), scene(coreScene(random)) {
    for (int i = 0; i < 4; ++i) scene.addPoint(random, 0.01);
  }
  void move(Scene& other, double size) {
    Vector6d residual;
    residual << size * Eigen::Vector3d(5.0, -3.0, 1.0), size * Eigen::Vector3d(0.2, -0.1, 1.0);
    // In the general form, that is with all of the state: as a loop is closed.
    correct(other.filter,
            {LinearMeasurement(residual, Matrix6d(1e-6 * Matrix6d::Identity())).by(0, Matrix6d::Identity())});
  }
  Random random;
  Scene scene;
};

TEST(Gauge, AnActivePointMovesRigidlyWithThePose) {
  WorldMoves world(5);
  Scene scene = world.scene;
  world.move(scene, 1.0);
  EXPECT_GT(distance(scene.filter.pose().matrix(), world.scene.filter.pose().matrix()), 1.0);
  for (const Handle point : scene.points) {
    const Eigen::Vector3d seen = scene.filter.pose().inverse() * scene.filter.variables().point(point);
    const Eigen::Vector3d before =
        world.scene.filter.pose().inverse() * world.scene.filter.variables().point(point);
    EXPECT_LT(distance(seen, before), 1e-10);
    // And is as well known as it was, along the axes of the body.
    const Eigen::Matrix3d turn =
        scene.filter.pose().rotation() * world.scene.filter.pose().rotation().transpose();
    EXPECT_LT(distance(scene.filter.covariance(point),
                       turn * world.scene.filter.covariance(point) * turn.transpose()),
              1e-12);
  }
}

// What is known of a point that was away meanwhile is what it would be of one that stayed; where it lies, to
// second order in what the world was turned by.
TEST(Gauge, APointThatWasInactiveComesBackAsIfItHadStayed) {
  WorldMoves world(6);
  for (const double size : {0.1, 0.01, 0.0}) {
    Scene stayed = world.scene, went = world.scene;
    for (const Handle point : went.points) went.filter.deactivate(point);
    for (Scene* scene : {&stayed, &went}) world.move(*scene, size);
    EXPECT_LT(distance(stayed.filter.pose().matrix(), went.filter.pose().matrix()), 1e-12);
    EXPECT_GE(distance(stayed.filter.pose().matrix(), world.scene.filter.pose().matrix()), size);
    went.filter.activate(went.points);
    double worst = 0.0;
    for (const Handle point : stayed.points) {
      worst = std::max(
          worst, distance(stayed.filter.variables().point(point), went.filter.variables().point(point)));
      std::vector<Handle> all = stayed.points;
      for (const Handle core : {Handle{0}, handleOf(stayed.filter, ConstantTwist::kTwist)})
        all.push_back(core);
      for (const Handle other : all) {
        const Eigen::MatrixXd expected = stayed.filter.covariance(point, other);
        EXPECT_LT(distance(expected, went.filter.covariance(point, other)), 1e-11 + 2.0 * size * 0.1);
      }
    }
    EXPECT_LT(worst, 1e-12 + 10.0 * size * size);
  }
}

} // namespace
} // namespace vi_ekf_slam::test

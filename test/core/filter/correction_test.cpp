// What a correction does to mean and covariance, against the textbook and the definition of the errors.

#include <limits>

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

/// What is left of an error once its expectation has been taken off, about the body's new position. `all`:
/// along the axes that have turned; in a period of the core points keep theirs.
Eigen::MatrixXd leftOf(const Filter& filter, const SE3& before, bool all) {
  Eigen::MatrixXd T = Eigen::MatrixXd::Identity(filter.rows(), filter.rows());
  const Eigen::Matrix3d turn = filter.pose().rotation() * before.rotation().transpose();
  if (filter.isLevel()) {
    T.block<3, 3>(3, 3) = so3::leftJacobian(so3::Log(turn));
    T.block<3, 3>(3, 3).col(2) = Eigen::Vector3d::UnitZ();
  }
  T.block<3, 3>(0, 3) = -so3::hat(filter.pose().translation() - before.translation()) * T.block<3, 3>(3, 3);
  for (const Handle handle : filter.variables().handles()) {
    const Chart chart = filter.variables().chartOf(handle);
    if (chart == Chart::kWorldVector || (all && chart == Chart::kPoint))
      T.block<3, 3>(filter.rowOf(handle), filter.rowOf(handle)) = turn;
  }
  return T;
}

LinearMeasurement velocityOf(const Scene& scene, const Eigen::Vector3d& residual, const Eigen::Matrix3d& R) {
  return LinearMeasurement(residual, R)
      .by(scene.filter.rowOf(handleOf(scene.filter, ConstantTwist::kTwist)), Eigen::Matrix3d::Identity())
      .by(scene.filter.rowOf(handleOf(scene.filter, ConstantTwist::kBias)), Eigen::Matrix3d::Identity());
}

TEST(Correction, OfTheCoreIsTheTextbooks) {
  Random random(3);
  for (int run = 0; run < 5; ++run) {
    Scene scene = busyScene(random);
    const State before = stateOf(scene.filter);
    const Eigen::MatrixXd P = scene.filter.covariance();
    const Eigen::Matrix3d R = 0.01 * random.covariance<3>();
    const LinearMeasurement z = velocityOf(scene, 0.01 * random.vector<3>(-1.0, 1.0), R);
    ASSERT_TRUE(scene.filter.correct(z));
    scene.filter.settle();

    const Eigen::MatrixXd H = denseOf(z, P.rows());
    const Eigen::MatrixXd K = P * H.transpose() * inverseOf(H * P * H.transpose() + R);
    const Eigen::MatrixXd I_KH = Eigen::MatrixXd::Identity(P.rows(), P.cols()) - K * H;
    const Eigen::MatrixXd T = leftOf(scene.filter, before.pose, false);
    const Eigen::MatrixXd expected =
        T * (I_KH * P * I_KH.transpose() + K * R * K.transpose()) * T.transpose();
    EXPECT_LT(relativeDistance(scene.filter.covariance(), expected), 1e-11);
    expectCovariance(scene.filter.covariance());

    const Eigen::VectorXd error = K * Eigen::Vector3d(z.residual());
    const Eigen::Index c = scene.filter.coreRows();
    const Eigen::VectorXd made = errorOf(scene.filter.variables(), stateOf(scene.filter), before);
    EXPECT_LT(distance(made.head(c), error.head(c)), 1e-11);
    EXPECT_LT(distance(made, error), 20.0 * error.squaredNorm()) << "points, along the world axes";
  }
}

TEST(Correction, OfAnythingIsTheTextbooksAndRetractsByTheDefinitionOfTheErrors) {
  Random random(4);
  for (int run = 0; run < 5; ++run) {
    Scene scene = busyScene(random, 4, run % 2 == 0 ? 0.02 : 0.0);
    const Eigen::Vector3d velocity = random.vector<3>(-5.0, 5.0);
    scene.filter.augment(Chart::kWorldVector, velocity, 0.1 * random.covariance<3>(),
                         {0, 0.3 * randomMatrix(random, 3, scene.filter.rows())});
    const State before = stateOf(scene.filter);
    const Eigen::MatrixXd P = scene.filter.covariance();
    std::vector<LinearMeasurement> all = scene.seen(random, 3.0);
    all.push_back(LinearMeasurement(0.1 * random.vector<6>(-1.0, 1.0), 0.1 * random.covariance<6>())
                      .by(0, randomMatrix(random, 6, 6))
                      .by(scene.filter.rows() - 3, randomMatrix(random, 6, 3)));
    correct(scene.filter, all);

    const DenseMeasurement z = denseOf(all, P.rows());
    const Eigen::MatrixXd K = P * z.H.transpose() * inverseOf(z.H * P * z.H.transpose() + z.R);
    const Eigen::MatrixXd I_KH = Eigen::MatrixXd::Identity(P.rows(), P.cols()) - K * z.H;
    const Eigen::MatrixXd T = leftOf(scene.filter, before.pose, true);
    const Eigen::MatrixXd expected =
        T * (I_KH * P * I_KH.transpose() + K * z.R * K.transpose()) * T.transpose();
    EXPECT_LT(worstCorrelationError(scene.filter.covariance(), expected), 1e-10);
    EXPECT_LT(distance(errorOf(scene.filter.variables(), stateOf(scene.filter), before), K * z.residual),
              1e-10);
    EXPECT_TRUE(so3::isRotation(scene.filter.pose().rotation(), 1e-12));
    expectCovariance(scene.filter.covariance());
  }
}

TEST(Correction, InInverseDepthRetractsByTheErrorsToFirstOrder) {
  Random random(5);
  const Scene start = busyScene(random);
  for (const double size : {1.0, 0.1}) {
    Scene scene = start;
    const auto all = scene.seen(random, size);
    const State before = stateOf(scene.filter);
    Innovation in(scene.filter.covariance(), all);
    ASSERT_TRUE(in.factorise());
    ASSERT_TRUE(scene.filter.correct(in, scene.model().inverseDepthChart(start.filter)));
    const Eigen::VectorXd made = errorOf(scene.filter.variables(), stateOf(scene.filter), before);
    EXPECT_LT(distance(made, in.error()), 2.0 * in.error().squaredNorm()) << size;
  }
}

TEST(Correction, IsRefusedWhereItIsNoneAndNothingChanges) {
  Random random(6);
  const Scene start = busyScene(random);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  const Eigen::Vector3d residual(0.1, 0.2, 0.3);
  const auto expectRefused = [&](const LinearMeasurement& z) {
    Scene scene = start;
    EXPECT_FALSE(scene.filter.correct(z));
    EXPECT_EQ(distance(scene.filter.covariance(), start.filter.covariance()), 0.0);
    EXPECT_EQ(distance(scene.filter.pose().matrix(), start.filter.pose().matrix()), 0.0);
    EXPECT_EQ(distance(stateOf(scene.filter).x, stateOf(start.filter).x), 0.0);
  };
  const auto ofPoint = [&](const Eigen::Vector3d& y, const Eigen::Matrix3d& noise) {
    return LinearMeasurement(y, noise).by(start.filter.rowOf(start.points[0]), Eigen::Matrix3d::Identity());
  };
  expectRefused(velocityOf(start, residual, -100.0 * R));
  expectRefused(velocityOf(start, residual, nan * R));
  expectRefused(velocityOf(start, nan * residual, R));
  expectRefused(ofPoint(residual, -100.0 * R));
  expectRefused(ofPoint(residual, nan * R));
  expectRefused(ofPoint(nan * residual, R));
  expectRefused(LinearMeasurement(residual, R).by(0, Eigen::Matrix3d::Constant(nan)));
}

TEST(Correction, ResetForgetsAVariableAndNothingElse) {
  Random random(9);
  Scene scene = busyScene(random);
  const Handle twist = handleOf(scene.filter, ConstantTwist::kTwist);
  Eigen::MatrixXd expected = scene.filter.covariance();
  const Eigen::Index row = scene.filter.rowOf(twist);
  expected.middleRows<6>(row).setZero();
  expected.middleCols<6>(row).setZero();
  const Matrix6d covariance = random.covariance<6>();
  expected.block<6, 6>(row, row) = covariance;
  const State before = stateOf(scene.filter);
  scene.filter.makeIndependent(row, covariance);
  EXPECT_EQ(distance(scene.filter.covariance(), expected), 0.0);
  EXPECT_EQ(distance(stateOf(scene.filter).x, before.x), 0.0);
}

TEST(Correction, IsTheSameHoweverOftenTheCoreIsSettled) {
  Random random(10);
  Scene once = busyScene(random, 4, 0.02);
  once.filter.deactivate(once.points.back());
  once.points.pop_back();
  Scene often = once;
  for (int i = 0; i < 50; ++i) {
    for (Scene* scene : {&once, &often}) {
      scene->motion.propagate(scene->filter, 0.01);
      ASSERT_TRUE(scene->filter.correct(
          velocityOf(*scene, Eigen::Vector3d::Zero(), 0.01 * Eigen::Matrix3d::Identity())));
    }
    often.filter.settle();
  }
  EXPECT_LT(worstCorrelationError(jointOf(once.filter), jointOf(often.filter)), 1e-10);
}

} // namespace
} // namespace vi_ekf_slam::test

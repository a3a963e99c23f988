// Another frame for the whole world, errors along its axes, and points that come from elsewhere.

#include <stdexcept>

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

TEST(WorldFrame, CovariancesAlongItsAxesAreThoseOfTheTruth) {
  Random random(10);
  const Scene scene = busyScene(random, 3, 0.02);
  const State estimate = stateOf(scene.filter);
  const Variables& variables = scene.filter.variables();
  const Eigen::MatrixXd P = scene.filter.covariance();
  const Eigen::MatrixXd J = derivative(
      [&](const Eigen::VectorXd& error) {
        const State truth = truthAt(variables, estimate, error);
        Eigen::VectorXd d = truth.x - estimate.x;
        d.head<6>() << truth.pose.translation() - estimate.pose.translation(),
            so3::Log(truth.pose.rotation() * estimate.pose.rotation().transpose());
        return d;
      },
      scene.filter.rows());
  const Eigen::MatrixXd expected = J * P * J.transpose();
  for (const Handle point : scene.points) {
    const Eigen::Index row = scene.filter.rowOf(point);
    const Eigen::Matrix3d own = expected.block<3, 3>(row, row);
    EXPECT_LT(relativeDistance(scene.filter.worldCovariance(point), own), 1e-8);
  }
}

TEST(WorldFrame, WhatIsInactiveIsAlongItsAxesAlready) {
  Random random(11);
  Scene scene = busyScene(random, 6);
  const auto along = [&scene](const Eigen::MatrixXd& P) {
    return Eigen::MatrixXd(worldAxesOf(scene.filter) * P);
  };
  const auto covariance = [&] { return along(along(scene.filter.covariance()).transpose()); };
  const Eigen::MatrixXd before = covariance();
  const Eigen::Index n = scene.filter.rows();
  // The last ones, so that the others' rows stay.
  for (std::size_t i = 6; i-- > 3;) scene.filter.deactivate(scene.points[i]);
  scene.filter.settleInactive();
  const Eigen::Index left = scene.filter.rows();
  EXPECT_LT(distance(covariance(), before.topLeftCorner(left, left)), 1e-12);
  for (std::size_t i = 0; i < 3; ++i) { // the last one left first
    const Eigen::Index row = n - 3 * static_cast<Eigen::Index>(i + 1);
    EXPECT_LT(distance(along(scene.filter.inactive().cross()).middleCols<3>(scene.filter.inactive().rowOf(i)),
                       before.block(0, row, left, 3)),
              1e-12);
    EXPECT_LT(distance(scene.filter.inactive().covariance().block(scene.filter.inactive().rowOf(i),
                                                                  scene.filter.inactive().rowOf(i), 3, 3),
                       before.block<3, 3>(row, row)),
              1e-12);
  }
}

TEST(WorldFrame, AnotherOneTakesErrorsAsTheirDefinitionDoes) {
  Random random(24);
  Scene scene = busyScene(random, 3, 0.02);
  scene.filter.augment(Chart::kWorldVector, random.vector<3>(-5.0, 5.0), 0.1 * random.covariance<3>(),
                       {0, 0.3 * randomMatrix(random, 3, scene.filter.rows())});
  const State before = stateOf(scene.filter);
  const Variables variables = scene.filter.variables();
  const Eigen::MatrixXd P = scene.filter.covariance();
  const SE3 T = SE3::Exp((Vector6d() << 30.0, -20.0, 5.0, 0.4, -0.3, 1.9).finished());
  const auto movedBy = [&](const State& state) {
    State moved{T * state.pose, state.x};
    for (const Handle handle : variables.handles()) {
      auto x = moved.x.segment(variables.rowOf(handle), variables.sizeOf(handle));
      if (variables.chartOf(handle) == Chart::kPoint) x = T * Eigen::Vector3d(x);
      if (variables.chartOf(handle) == Chart::kWorldVector) x = (T.rotation() * x).eval();
    }
    return moved;
  };
  scene.filter.moveWorld(T);
  const State after = movedBy(before);
  EXPECT_LT(distance(scene.filter.pose().matrix(), after.pose.matrix()), 1e-12);
  EXPECT_LT(distance(stateOf(scene.filter).x, after.x), 1e-12);
  const Eigen::MatrixXd J = derivative(
      [&](const Eigen::VectorXd& error) {
        return errorOf(variables, movedBy(truthAt(variables, before, error)), after);
      },
      P.rows());
  EXPECT_LT(worstCorrelationError(scene.filter.covariance(), J * P * J.transpose()), 1e-9);
}

TEST(WorldFrame, AnotherOneLeavesWhatIsSeenFromTheBodyAsItWas) {
  Random random(25);
  Scene scene = busyScene(random);
  const auto fromBody = [&] {
    const Eigen::Matrix3d& R = scene.filter.pose().rotation();
    return Eigen::Matrix3d(R.transpose() * scene.filter.covariance(scene.points[0]) * R);
  };
  const Eigen::Matrix3d before = fromBody();
  scene.filter.moveWorld(SE3::Exp((Vector6d() << 300.0, -20.0, 5.0, 0.4, -0.3, 1.9).finished()));
  EXPECT_LT(distance(before, fromBody()), 1e-12);
}

TEST(WorldFrame, IsNotMovedWhileAnythingIsInactive) {
  Random random(26);
  Scene scene = busyScene(random);
  scene.filter.deactivate(scene.points[0]);
  EXPECT_THROW(scene.filter.moveWorld(SE3()), std::logic_error);
}

TEST(WorldFrame, AdoptedPointsTakePartAsTheTextbookHasIt) {
  Random random(23);
  Scene scene = busyScene(random, 4);
  scene.filter.deactivate(scene.points.back()); // makes room for what comes
  scene.points.pop_back();
  const Eigen::MatrixXd before = scene.filter.covariance(), adopted = randomCovariance(random, 15, 0.1);
  const Eigen::Index n = before.rows();
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 5; ++i) points.push_back(random.vector<3>(-20.0, 20.0));
  const std::vector<Handle> handles = scene.filter.adopt(points, adopted, Eigen::MatrixXd::Zero(n, 15));
  ASSERT_EQ(handles.size(), 5u);
  EXPECT_EQ(scene.filter.inactive().size(), 5u);
  EXPECT_GT(scene.filter.inactive().deactivatedSince(handles[0]), 1000000u);

  scene.filter.activate({handles[3], handles[1]});
  Eigen::MatrixXd F = Eigen::MatrixXd::Zero(n + 6, n + 6), P = Eigen::MatrixXd::Zero(n + 6, n + 6);
  F.setIdentity();
  P.topLeftCorner(n, n) = before;
  const int chosen[] = {1, 3}; // in the order in which they are in the store
  for (int i = 0; i < 2; ++i) {
    F.block<3, 6>(n + 3 * i, 0) =
        byPose(points[static_cast<std::size_t>(chosen[i])], scene.filter.pose().translation());
    for (int j = 0; j < 2; ++j)
      P.block<3, 3>(n + 3 * i, n + 3 * j) = adopted.block<3, 3>(3 * chosen[i], 3 * chosen[j]);
  }
  EXPECT_LT(worstCorrelationError(scene.filter.covariance(), F * P * F.transpose()), 1e-11);
  EXPECT_EQ(scene.filter.variables().point(handles[3]), points[3]);
}

TEST(WorldFrame, WhatIsAdoptedAsItWasIsAsItWas) {
  Random random(27);
  Scene scene = busyScene(random, 8);
  for (std::size_t i = 8; i-- > 4;) scene.filter.deactivate(scene.points[i]);
  scene.filter.settleInactive();
  Filter again = scene.filter;
  std::vector<Eigen::Vector3d> points;
  for (const InactiveVariable& variable : again.inactive().variables()) points.emplace_back(variable.mean);
  const SymmetricPanels& P = again.inactive().covariance();
  again.adopt(points, P.middleRows(0, P.rows()), again.inactive().cross());
  const auto go = [&](Filter& filter) {
    scene.motion.propagate(filter, 0.1);
    filter.settle();
    Scene seen{filter, scene.motion, {}, {scene.points.begin(), scene.points.begin() + 4}};
    Random same(28);
    correct(filter, seen.seen(same, 1.0));
  };
  go(again);
  go(scene.filter);
  EXPECT_LT(worstCorrelationError(jointOf(again), jointOf(scene.filter)), 1e-10);
}

} // namespace
} // namespace vi_ekf_slam::test

#include "vi_ekf_slam/core/filter/variables.hpp"

#include <algorithm>
#include <stdexcept>

#include "states.hpp"

namespace vi_ekf_slam::test {
namespace {

Eigen::VectorXd filled(Eigen::Index size, double value) { return Eigen::VectorXd::Constant(size, value); }

TEST(VariablesTest, LieOneBehindTheOtherFromThePoseOn) {
  Variables variables{SE3()};
  const Handle a = variables.add(Chart::kVector, filled(4, 1.0)),
               b = variables.add(Chart::kPoint, filled(3, 2.0));
  EXPECT_EQ(variables.rowOf(0), 0);
  EXPECT_EQ(variables.sizeOf(0), 6);
  EXPECT_EQ(variables.rowOf(a), 6);
  EXPECT_EQ(variables.rowOf(b), 10);
  EXPECT_EQ(variables.rows(), 13);
  EXPECT_EQ(variables.handles(), (std::vector<Handle>{0, a, b}));
  EXPECT_EQ(variables.point(b), Eigen::Vector3d::Constant(2.0));
  EXPECT_EQ(variables.chartOf(b), Chart::kPoint);
}

TEST(VariablesTest, ARemovedOnesPlaceIsTakenByTheLastOfItsSize) {
  Variables variables{SE3()};
  std::vector<Handle> points;
  for (int i = 0; i < 4; ++i) points.push_back(variables.add(Chart::kPoint, filled(3, i)));
  const Variables::Gone gone = variables.remove(points[1]);
  EXPECT_EQ(gone.row, 9);
  EXPECT_EQ(gone.size, 3);
  EXPECT_EQ(gone.from, 15);
  EXPECT_FALSE(gone.shifts);
  EXPECT_FALSE(variables.contains(points[1]));
  EXPECT_EQ(variables.rowOf(points[3]), 9);
  EXPECT_EQ(variables.rowOf(points[2]), 12);
  EXPECT_EQ(variables.handles(), (std::vector<Handle>{0, points[0], points[3], points[2]}));
  for (const int i : {0, 2, 3})
    EXPECT_EQ(variables.point(points[static_cast<std::size_t>(i)]), Eigen::Vector3d::Constant(i));
  // Of the same matrix the same rows.
  Eigen::VectorXd rows = Eigen::VectorXd::LinSpaced(18, 0.0, 17.0);
  eraseRows(rows, gone, 18);
  EXPECT_EQ(rows.segment<3>(9), Eigen::Vector3d(15.0, 16.0, 17.0));
}

TEST(VariablesTest, WhereTheLastIsOfAnotherSizeAllBehindMoveUp) {
  Variables variables{SE3()};
  const Handle a = variables.add(Chart::kVector, filled(2, 1.0)),
               b = variables.add(Chart::kPoint, filled(3, 2.0));
  const Handle c = variables.add(Chart::kVector, filled(1, 3.0));
  const Variables::Gone gone = variables.remove(a);
  EXPECT_TRUE(gone.shifts);
  EXPECT_EQ(variables.rowOf(b), 6);
  EXPECT_EQ(variables.rowOf(c), 9);
  EXPECT_EQ(variables.rows(), 10);
  EXPECT_EQ(variables.handles(), (std::vector<Handle>{0, b, c}));
  EXPECT_EQ(variables.point(b), Eigen::Vector3d::Constant(2.0));
  EXPECT_EQ(variables.mean(c)[0], 3.0);
  Eigen::VectorXd rows = Eigen::VectorXd::LinSpaced(12, 0.0, 11.0);
  eraseRows(rows, gone, 12);
  EXPECT_EQ(rows.segment<4>(6), Eigen::Vector4d(8.0, 9.0, 10.0, 11.0));
}

TEST(VariablesTest, AHandleIsReusedOnceItIsReleasedAndNotBefore) {
  Variables variables{SE3()};
  const Handle a = variables.add(Chart::kPoint, filled(3, 1.0)),
               b = variables.add(Chart::kPoint, filled(3, 2.0));
  variables.remove(a, Variables::Fate::kKeepsHandle);
  const Handle c = variables.add(Chart::kPoint, filled(3, 3.0));
  EXPECT_NE(c, a);
  EXPECT_EQ(variables.chartOf(a), Chart::kPoint);
  variables.restore(a, filled(3, 4.0));
  EXPECT_EQ(variables.handles(), (std::vector<Handle>{0, b, c, a}));
  EXPECT_EQ(variables.point(a), Eigen::Vector3d::Constant(4.0));
  variables.remove(b);
  EXPECT_EQ(variables.add(Chart::kVector, filled(2, 5.0)), b);
  EXPECT_EQ(variables.point(c), Eigen::Vector3d::Constant(3.0));
  EXPECT_EQ(variables.point(a), Eigen::Vector3d::Constant(4.0));
}

TEST(VariablesTest, AreFoundByTheirNamesUntilTheyAreRemoved) {
  Variables variables{SE3()};
  const Handle a = variables.add(Chart::kVector, filled(4, 1.0), "a"),
               point = variables.add(Chart::kPoint, filled(3, 2.0)),
               b = variables.add(Chart::kVector, filled(4, 3.0), "b");
  EXPECT_EQ(variables.find("a"), a);
  EXPECT_EQ(variables.find("b"), b);
  EXPECT_FALSE(variables.find("c") || variables.find(""));
  EXPECT_THROW(variables.add(Chart::kVector, filled(1, 0.0), "a"), std::logic_error);
  variables.remove(point);
  EXPECT_EQ(variables.named().size(), 2u);
  variables.remove(a);
  EXPECT_FALSE(variables.find("a"));
  EXPECT_EQ(variables.find("b"), b);
  EXPECT_EQ(variables.find(""), std::nullopt);
  const Handle again = variables.add(Chart::kVector, filled(2, 0.0), "a");
  EXPECT_EQ(variables.find("a"), again);
}

TEST(VariablesTest, RefusesWhatFitsNoChart) {
  Variables variables{SE3()};
  EXPECT_THROW(variables.add(Chart::kPoint, filled(2, 0.0)), std::logic_error);
  EXPECT_THROW(variables.add(Chart::kWorldVector, filled(4, 0.0)), std::logic_error);
  EXPECT_THROW(variables.add(Chart::kBodyVector, filled(4, 0.0)), std::logic_error);
  EXPECT_THROW(variables.add(Chart::kVector, filled(0, 0.0)), std::logic_error);
  EXPECT_THROW(variables.add(Chart::kPose, filled(6, 0.0)), std::logic_error);
  EXPECT_THROW(variables.remove(0), std::logic_error);
  const Handle a = variables.add(Chart::kVector, filled(2, 0.0));
  variables.remove(a);
  EXPECT_THROW(variables.remove(a), std::logic_error);
}

TEST(VariablesTest, MoveByTheirErrorsAsTheseAreDefinedAndNoFurtherThanTold) {
  Random random(1);
  Variables variables(SE3(so3::Exp({0.1, 0.2, 0.3}), {10.0, -20.0, 3.0}));
  variables.add(Chart::kVector, random.vector<6>(-1.0, 1.0));
  variables.add(Chart::kWorldVector, random.vector<3>(-5.0, 5.0));
  variables.add(Chart::kBodyVector, random.vector<6>(-1.0, 1.0));
  const Eigen::Index core = variables.rows();
  const Handle point = variables.add(Chart::kPoint, random.vector<3>(-20.0, 20.0));
  const auto state = [](const Variables& v) {
    State s{v.pose(), Eigen::VectorXd::Zero(v.rows())};
    for (const Handle h : v.handles())
      if (v.chartOf(h) != Chart::kPose) s.x.segment(v.rowOf(h), v.sizeOf(h)) = v.mean(h);
    return s;
  };
  const State before = state(variables);
  const Eigen::VectorXd error = 0.5 * randomMatrix(random, variables.rows(), 1);
  Variables some = variables, all = variables;
  all.retract(error, all.rows(), {});
  const State after = truthAt(variables, before, error);
  EXPECT_LT(distance(all.pose().matrix(), after.pose.matrix()), 1e-12);
  EXPECT_LT(distance(state(all).x, after.x), 1e-12);
  EXPECT_LT(distance(errorOf(variables, state(all), before), error), 1e-12);
  some.retract(error, core, {});
  EXPECT_EQ(some.point(point), variables.point(point));
  EXPECT_LT(distance(state(some).x.head(core), after.x.head(core)), 1e-12);
}

/// Of a body whose tilt is learnt in two steps, one of them about x: what is left is about z too.
TEST(VariablesTest, WhatIsLeftOfARotationsErrorIsToldToFirstOrder) {
  Random random(5);
  Variables start(SE3(so3::Exp({0.1, 0.2, 0.3}), {10.0, -20.0, 3.0}));
  start.add(Chart::kWorldVector, random.vector<3>(-5.0, 5.0));
  for (int run = 0; run < 20; ++run) {
    Eigen::VectorXd correction = Eigen::VectorXd::Zero(start.rows());
    correction.segment<3>(3) = random.vector<3>(-0.1, 0.1);
    const Eigen::Vector3d rest =
        1e-4 * Eigen::Vector3d(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0), 0.0);
    const Eigen::Matrix3d truth = so3::Exp(correction.segment<3>(3) + rest) * start.pose().rotation();
    Variables corrected = start;
    const auto reexpressed = corrected.retract(correction, corrected.rows(), {});
    const auto turn =
        std::find_if(reexpressed.begin(), reexpressed.end(), [](const auto& r) { return r.row == 3; });
    ASSERT_NE(turn, reexpressed.end());
    const Eigen::Vector3d left = so3::Log(truth * corrected.pose().rotation().transpose());
    EXPECT_LT(distance(left, turn->M * rest), 1e-8); // 1e-5 off without M
    EXPECT_EQ(distance(turn->M * Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitZ()), 0.0);
  }
}

/// No axis is another one where none is the vertical's.
TEST(VariablesTest, ARotationsErrorIsLeftAsItIsWithoutGravity) {
  Variables variables{SE3()};
  variables.add(Chart::kVector, filled(6, 0.0));
  EXPECT_TRUE(variables.retract(filled(12, 0.1), variables.rows(), {}).empty());
}

/// What is left of its error is where it was in the world, whatever the correction turned the body by.
TEST(VariablesTest, AVectorOfTheBodyIsReexpressedByTheBodysTurn) {
  Random random(2);
  Variables variables(SE3(so3::Exp({0.1, 0.2, 0.3}), {1.0, 2.0, 3.0}));
  const Handle bias = variables.add(Chart::kBodyVector, random.vector<3>(-1.0, 1.0));
  Eigen::VectorXd error = randomMatrix(random, 9, 1), corrected = error;
  corrected.tail<3>() = random.vector<3>(-1.0, 1.0);
  const Eigen::Matrix3d R = so3::Exp(error.segment<3>(3)) * variables.pose().rotation();
  const Eigen::Vector3d truth =
      variables.mean(bias) + R.transpose() * variables.pose().rotation() * error.tail<3>();
  const auto reexpressed = variables.retract(corrected, 9, {});
  ASSERT_EQ(reexpressed.size(), 1U);
  EXPECT_EQ(reexpressed[0].row, 6);
  EXPECT_LT(distance(truth - variables.mean(bias), reexpressed[0].M * (error - corrected).tail<3>()), 1e-12);
}

/// A body that was blind for long learns how it was tilted and where it is: what it sees moves with it, and
/// no picture is another one. A chart that is not straight must not bend the points then.
TEST(VariablesTest, PointsMoveRigidlyWithABodyThatIsMovedWithThem) {
  Random random(4);
  Variables variables(SE3(so3::Exp({0.1, 0.2, 0.3}), {10.0, -20.0, 3.0}));
  variables.add(Chart::kWorldVector, random.vector<3>(-5.0, 5.0));
  std::vector<Handle> points;
  for (int i = 0; i < 12; ++i)
    points.push_back(
        variables.add(Chart::kPoint, variables.pose().translation() + random.vector<3>(-20.0, 20.0)));
  const Variables before = variables;
  Eigen::VectorXd error = Eigen::VectorXd::Zero(variables.rows());
  error.head<6>() << 5.0, -2.0, 1.0, 0.1, -0.05, 0.02;
  const PointChart bent{[](const Eigen::Matrix3d&, const Eigen::Vector3d& way, const Eigen::Vector3d& d) {
    return std::optional<MovedPoint>(
        MovedPoint{way + d + 0.2 * d.norm() * d, Eigen::Matrix3d::Identity(), {}});
  }};
  variables.retract(error, variables.rows(), bent);
  const SE3 moved = variables.pose() * before.pose().inverse();
  for (const Handle point : points)
    EXPECT_LT(distance(variables.point(point), moved * before.point(point)), 1e-12);
}

TEST(VariablesTest, MoveWithAWorldThatIsGivenAnotherFrame) {
  Random random(2);
  Variables variables(SE3(so3::Exp({0.1, 0.2, 0.3}), {10.0, -20.0, 3.0}));
  const Handle point = variables.add(Chart::kPoint, random.vector<3>(-20.0, 20.0));
  const Handle velocity = variables.add(Chart::kWorldVector, random.vector<3>(-5.0, 5.0));
  const Handle bias = variables.add(Chart::kVector, random.vector<3>(-5.0, 5.0));
  const Variables before = variables;
  const SE3 T = SE3::Exp((Vector6d() << 30.0, -20.0, 5.0, 0.4, -0.3, 1.9).finished());
  variables.moveWorld(T);
  EXPECT_LT(distance(variables.pose().matrix(), (T * before.pose()).matrix()), 1e-12);
  EXPECT_LT(distance(variables.point(point), T * before.point(point)), 1e-12);
  EXPECT_LT(distance(variables.mean(velocity), T.rotation() * before.mean(velocity)), 1e-12);
  EXPECT_EQ(distance(variables.mean(bias), before.mean(bias)), 0.0);
}

} // namespace
} // namespace vi_ekf_slam::test

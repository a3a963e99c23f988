// The path as clones of the pose: what a loop makes of it.

#include "vi_ekf_slam/core/map/pose_clones.hpp"

#include <gtest/gtest.h>

#include "../numeric.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr Stamp kSecond = 1000000000;
constexpr double kStepSigma = 0.1, kPointSigma = 0.05; // m

/// A body that does not turn, so that everything about it is linear: it goes 6 m a step and is told with
/// noise how far, and sees one point at the start and again at the end.
class StraightDrive {
 public:
  explicit StraightDrive(int steps) : steps_(steps), filter_(SE3(), start()) {
    filter_.closeCore();
    clones_.add(filter_, 0);
    point_ =
        filter_.augment(Chart::kPoint, Eigen::Vector3d(5.0, 1.0, 0.0), 0.01 * Eigen::Matrix3d::Identity());
    filter_.deactivate(point_);
    for (int i = 1; i <= steps; ++i) {
      moves_.emplace_back(Eigen::Vector3d(6.0, 0.0, 0.0) + kStepSigma * random_.vector<3>(-1.7, 1.7));
      CoreStep step;
      step.F = Eigen::MatrixXd::Identity(6, 6);
      step.Q = Eigen::MatrixXd::Zero(6, 6);
      step.Q.topLeftCorner<3, 3>().diagonal().setConstant(kStepSigma * kStepSigma);
      step.pose = SE3(Eigen::Matrix3d::Identity(), filter_.pose().translation() + moves_.back());
      filter_.propagate(step);
      clones_.add(filter_, i * kSecond);
    }
  }

  /// y = x - p is seen as `seen`, `later` than the last clone.
  std::optional<ClosedLoop> close(const Eigen::Vector3d& seen, Stamp later = 0) {
    const SE3 before = filter_.pose();
    const Matrix6d covariance = filter_.covariance().topLeftCorner<6, 6>();
    filter_.activate({point_});
    const Eigen::Vector3d y = filter_.variables().point(point_) - before.translation();
    LinearMeasurement z(seen - y, kPointSigma * kPointSigma * Eigen::Matrix3d::Identity());
    z.by(filter_.rowOf(point_), Eigen::Matrix3d::Identity());
    EXPECT_TRUE(filter_.correct(z));
    return clones_.close(filter_, steps_ * kSecond + later, before, covariance, 0, 1);
  }

  PathEstimate path() const {
    return clones_.estimate(filter_, filter_.inactive().estimates(true), steps_ * kSecond);
  }

  /// (p_0 ... p_n, x) of least squares over all that was measured, and their covariance.
  std::pair<Eigen::VectorXd, Eigen::MatrixXd> batch(const Eigen::Vector3d* seen) const {
    const Eigen::Index n = 3 * (steps_ + 2), x = n - 3;
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    const auto add = [&](Eigen::Index from, Eigen::Index to, const Eigen::Vector3d& way, double variance) {
      Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, n);
      H.middleCols<3>(to).setIdentity();
      if (from >= 0) H.middleCols<3>(from) = -Eigen::Matrix3d::Identity();
      A += H.transpose() * H / variance;
      b += H.transpose() * way / variance;
    };
    add(-1, 0, Eigen::Vector3d::Zero(), start()(0, 0));
    // The point is where the filter took it to be at the start, whatever the first pose's error.
    add(0, x, Eigen::Vector3d(5.0, 1.0, 0.0), 0.01);
    for (int i = 0; i < steps_; ++i)
      add(3 * i, 3 * (i + 1), moves_[static_cast<std::size_t>(i)], kStepSigma * kStepSigma);
    if (seen) add(3 * steps_, x, *seen, kPointSigma * kPointSigma);
    const Eigen::LLT<Eigen::MatrixXd> llt(A);
    return {llt.solve(b), llt.solve(Eigen::MatrixXd::Identity(n, n))};
  }

  Filter& filter() { return filter_; }
  int steps() const { return steps_; }

 private:
  static Matrix6d start() {
    Matrix6d P = Matrix6d::Zero();
    P.topLeftCorner<3, 3>() = 0.01 * Eigen::Matrix3d::Identity();
    return P;
  }

  int steps_;
  Random random_{3};
  Filter filter_;
  PoseClones clones_;
  Handle point_ = 0;
  std::vector<Eigen::Vector3d> moves_;
};

TEST(PoseClones, AreTheBatchSolutionOfALinearDriveAfterALoop) {
  StraightDrive drive(40);
  const Eigen::Vector3d seen(-230.0, 2.0, 1.0);
  const auto loop = drive.close(seen);
  const auto [means, covariance] = drive.batch(&seen);
  const PathEstimate path = drive.path();
  ASSERT_EQ(path.nodes.size(), static_cast<std::size_t>(drive.steps()) + 1);
  for (std::size_t i = 0; i < path.nodes.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    EXPECT_LE((path.nodes[i].now.translation() - means.segment<3>(row)).norm(), 1e-9) << "node " << i;
    EXPECT_LE((path.nodes[i].covariance.topLeftCorner<3, 3>() - covariance.block<3, 3>(row, row)).norm(),
              1e-9)
        << "node " << i;
  }
  // What the event says of both ends.
  ASSERT_TRUE(loop);
  EXPECT_EQ(loop->ends.before, 0);
  EXPECT_EQ(loop->ends.now, drive.steps() * kSecond);
  const Eigen::Index end = 3 * drive.steps();
  EXPECT_LE((loop->before_T_now.translation() - (means.segment<3>(end) - means.head<3>())).norm(), 1e-9);
  const Eigen::Matrix3d between = covariance.block<3, 3>(end, end) + covariance.topLeftCorner<3, 3>() -
                                  covariance.block<3, 3>(end, 0) - covariance.block<3, 3>(0, end);
  EXPECT_LE((loop->covariance.topLeftCorner<3, 3>() - between).norm(), 1e-9);
}

TEST(PoseClones, ALoopMovesPosesBetweenInProportionAndNoneBefore) {
  StraightDrive drive(10);
  const PathEstimate before = drive.path();
  const Matrix6d P = Matrix6d::Identity();
  for (const PathNode& node : before.nodes)
    EXPECT_LE((before.at(node.stamp, node.after, P).world_T_imu.matrix() - node.after.matrix()).norm(), 1e-12)
        << "nothing was learned yet";
  drive.close(Eigen::Vector3d(-55.0, 3.0, 0.0));
  const PathEstimate path = drive.path();
  const PathNode &a = path.nodes[4], &b = path.nodes[5];
  const SE3 half(Eigen::Matrix3d::Identity(), 0.5 * (a.after.translation() + b.before.translation()));
  const Eigen::Vector3d moved =
      path.at((a.stamp + b.stamp) / 2, half, P).world_T_imu.translation() - half.translation();
  const Eigen::Vector3d by_a = a.now.translation() - a.after.translation(),
                        by_b = b.now.translation() - b.before.translation();
  EXPECT_GT(by_a.norm(), 0.1) << "the loop has moved the path";
  EXPECT_LE((moved - 0.5 * (by_a + by_b)).norm(), 1e-12);
  EXPECT_LE((path.nodes.back().after.translation() - path.nodes.back().now.translation()).norm(), 1e-12)
      << "where the loop was closed the pose is what was published";
}

/// Of a moment that is known as well as its motion, and of one that has noise of its own besides.
TEST(PoseClones, ALoopLeavesTheNoiseThatAMomentDoesNotShareWithThem) {
  for (const Stamp later : {Stamp(0), Stamp(1)}) { // with a clone of the moment that closes it, and without
    StraightDrive drive(10);
    const PathEstimate before = drive.path();
    drive.close(Eigen::Vector3d(-55.0, 3.0, 0.0), later);
    const PathEstimate path = drive.path();
    for (const std::size_t k : {4u, 9u}) {
      const PathNode &a = path.nodes[k], &b = path.nodes[k + 1];
      const SE3 half(Eigen::Matrix3d::Identity(), 0.5 * (a.after.translation() + b.before.translation()));
      const Matrix6d then = 0.5 * (before.nodes[k].covariance + before.nodes[k + 1].covariance);
      const Matrix6d now = 0.5 * (a.covariance + b.covariance);
      EXPECT_LT(now(0, 0), 0.8 * then(0, 0)) << "the loop tells of the path";
      Matrix6d own = Matrix6d::Zero();
      own.topLeftCorner<2, 2>() << 0.02, 0.01, 0.01, 0.03;
      const Stamp middle = (a.stamp + b.stamp) / 2;
      EXPECT_LE((path.at(middle, half, then).covariance - now).norm(), 1e-9) << k;
      EXPECT_LE((path.at(middle, half, then + own).covariance - now - own).norm(), 1e-9) << k;
      EXPECT_LE((path.at(middle, half, 0.5 * then).covariance - now).norm(), 1e-9)
          << "never less than theirs";
    }
  }
}

TEST(PoseClones, AreMadeWhereTheAttitudeIsLearnt) {
  Filter filter(SE3(), independentPose(0.01, 0.02));
  filter.closeCore();
  PoseClones clones;
  for (int i = 0; i < 3; ++i) clones.add(filter, i * kSecond); // nothing new
  const auto count = [&] {
    return clones.estimate(filter, filter.inactive().estimates(true), 9).nodes.size();
  };
  const std::size_t before = count();
  filter.makeIndependent(4, Eigen::Matrix<double, 1, 1>(std::pow(0.0199, 2))); // by 0.002 rad
  clones.add(filter, 3 * kSecond);
  EXPECT_EQ(count(), before + 1);
  clones.add(filter, 4 * kSecond);
  EXPECT_EQ(count(), before + 1);
}

TEST(PoseClones, MarginalisedOnesStayWhereTheyWere) {
  Filter filter(SE3(), 0.01 * Matrix6d::Identity());
  filter.closeCore();
  PoseClones clones;
  for (int i = 0; i < 4; ++i) {
    filter.begin(SE3(so3::Exp({0.0, 0.0, 0.1 * i}), {10.0 * i, 0.0, 0.0}));
    clones.add(filter, i * kSecond);
  }
  auto gone = filter.inactive().estimates(true);
  gone.resize(filter.marginaliseOldest(2).size());
  ASSERT_GE(gone.size(), 2U);
  clones.archive(gone);
  const PathEstimate path = clones.estimate(filter, filter.inactive().estimates(true), 3 * kSecond);
  ASSERT_EQ(path.nodes.size(), 4U);
  for (int i = 0; i < 4; ++i) {
    const SE3& now = path.nodes[static_cast<std::size_t>(i)].now;
    EXPECT_LE((now.translation() - Eigen::Vector3d(10.0 * i, 0.0, 0.0)).norm(), 1e-12);
    EXPECT_NEAR(so3::heading(now.rotation()), 0.1 * i, 1e-12);
  }
}

TEST(PoseClones, NothingIsCarriedOverAJump) {
  Filter filter(SE3(), 0.01 * Matrix6d::Identity());
  filter.closeCore();
  PoseClones clones;
  clones.add(filter, 0);
  clones.breakOff();
  filter.begin(SE3(Eigen::Matrix3d::Identity(), {100.0, 0.0, 0.0}));
  clones.add(filter, 2 * kSecond);
  const PathEstimate path = clones.estimate(filter, filter.inactive().estimates(true), 2 * kSecond);
  const SE3 then(Eigen::Matrix3d::Identity(), {1.0, 0.0, 0.0});
  EXPECT_EQ(path.at(kSecond, then, Matrix6d::Zero()).world_T_imu.translation(), then.translation());
}

} // namespace
} // namespace vi_ekf_slam::test

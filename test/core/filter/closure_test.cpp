// A large closure turns a piece of the map that is out of view: it is to stay as rigid as it is.

#include "states.hpp"
#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/core/filter/rigid_chain.hpp"
#include "vi_ekf_slam/core/health/recovery.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kKick = 10.0 * M_PI / 180.0; // rad

TEST(RigidChain, TurnsAMapAsAWhole) {
  Random random(1);
  std::vector<Eigen::Vector3d> points, corrections, expected;
  const Eigen::Vector3d phi(0.02, -0.03, kKick), pivot(3.0, 4.0, 0.0);
  for (int i = 0; i < 100; ++i) {
    points.push_back(Eigen::Vector3d(2.0 * i, 30.0 * std::sin(0.05 * i), 0.0) + random.vector<3>(-3.0, 3.0));
    corrections.push_back(phi.cross(points.back() - pivot));
    expected.push_back(pivot + so3::Exp(phi) * (points.back() - pivot));
  }
  const std::vector<Eigen::Vector3d> moved = moveAsChain(points, corrections);
  double linear = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_LT((moved[i] - expected[i]).norm(), 1e-3 + 3e-3 * (points[i] - pivot).norm()) << i;
    linear = std::max(linear, (points[i] + corrections[i] - expected[i]).norm());
  }
  EXPECT_GT(linear, 2.5);
}

TEST(RigidChain, IsAdditionToFirstOrder) {
  Random random(2);
  std::vector<Eigen::Vector3d> points, corrections;
  for (int i = 0; i < 37; ++i) {
    points.push_back(Eigen::Vector3d(3.0 * i, 0.0, 0.0) + random.vector<3>(-3.0, 3.0));
    corrections.push_back(1e-5 * random.vector<3>(-1.0, 1.0));
  }
  const std::vector<Eigen::Vector3d> moved = moveAsChain(points, corrections);
  for (std::size_t i = 0; i < points.size(); ++i)
    EXPECT_LT((moved[i] - points[i] - corrections[i]).norm(), 1e-8) << i;
  EXPECT_TRUE(moveAsChain({}, {}).empty());
}

/// Two laps with exact measurements; before the second one the estimate is turned, and told by how much it
/// may be. Each step sees three points of its own for five steps.
class TwoLaps {
 public:
  TwoLaps()
      : filter_(SE3(so3::Exp({0.0, 0.0, M_PI / 2}), {kRadius, 0.0, 0.0}), Matrix6d::Identity() * 1e-10) {
    filter_.closeCore();
    truth_ = filter_.pose();
  }

  void drive() {
    for (int step = 0; step < 2 * kSteps; ++step) {
      if (step == kSteps) {
        leave(in_view_.size());
        kick();
      }
      const SE3 motion = SE3::Exp((Vector6d() << kRadius * kAngle, 0.0, 0.0, 0.0, 0.0, kAngle).finished());
      truth_ = truth_ * motion;
      resetPose(filter_, motion, Matrix6d::Identity() * 1e-8);
      for (int k = 0; k < 3; ++k) {
        points_.push_back(truth_ * Eigen::Vector3d(random_.vector<3>(-6.0, 6.0)));
        const Eigen::Vector3d seen = filter_.pose() * (truth_.inverse() * points_.back());
        handles_.push_back(filter_.augment(Chart::kPoint, seen, 1e-6 * Eigen::Matrix3d::Identity()));
      }
      in_view_.insert(in_view_.end(), handles_.end() - 3, handles_.end());
      see(in_view_);
      if (in_view_.size() == 15) leave(3);
    }
  }

  /// Points of the first lap come into view again, for some frames.
  void close() {
    const std::vector<Handle> again(handles_.begin() + 9, handles_.begin() + 21);
    filter_.activate(again);
    for (int i = 0; i < 5; ++i) see(again);
    leave(in_view_.size());
    in_view_ = again;
    leave(again.size());
  }

  /// m, the largest error of the points of a lap that are out of view.
  double worst(int lap) {
    double result = 0.0;
    for (const auto& [estimate, truth] : outOfView(lap)) result = std::max(result, (estimate - truth).norm());
    return result;
  }

  /// m, by how much the distance of two of them is wrong at most.
  double stretch(int lap) {
    double result = 0.0;
    const auto points = outOfView(lap);
    for (const auto& [a, true_a] : points) {
      for (const auto& [b, true_b] : points)
        result = std::max(result, std::abs((a - b).norm() - (true_a - true_b).norm()));
    }
    return result;
  }

 private:
  static constexpr int kSteps = 60;
  static constexpr double kRadius = 30.0, kAngle = 2.0 * M_PI / kSteps; // m, rad

  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> outOfView(int lap) {
    std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> result;
    for (const auto& estimate : filter_.inactive().estimates(false)) {
      const auto i = indexOf(estimate.variable.handle);
      if (static_cast<int>(i) / (3 * kSteps) == lap) result.emplace_back(estimate.variable.mean, points_[i]);
    }
    return result;
  }

  std::size_t indexOf(Handle handle) const {
    return static_cast<std::size_t>(std::find(handles_.begin(), handles_.end(), handle) - handles_.begin());
  }

  void leave(std::size_t count) {
    const auto end = in_view_.begin() + static_cast<std::ptrdiff_t>(count);
    for (auto handle = in_view_.begin(); handle != end; ++handle) filter_.deactivate(*handle);
    in_view_.erase(in_view_.begin(), end);
  }

  void kick() {
    Matrix6d covariance = Matrix6d::Identity() * 1e-10;
    covariance(5, 5) = kKick * kKick;
    resetPose(filter_, SE3(so3::Exp({0.0, 0.0, kKick}), Eigen::Vector3d::Zero()), covariance);
  }

  void see(const std::vector<Handle>& handles) {
    const double sigma = 1e-3;
    std::vector<LinearMeasurement> all;
    for (const Handle handle : handles) {
      const auto i =
          static_cast<std::size_t>(std::find(handles_.begin(), handles_.end(), handle) - handles_.begin());
      const SE3& pose = filter_.pose();
      const Eigen::Vector3d z = truth_.inverse() * points_[i];
      const Eigen::Matrix3d H = pose.rotation().transpose();
      const Eigen::Vector3d expected = H * (filter_.variables().point(handle) - pose.translation());
      all.push_back(LinearMeasurement(z - expected, sigma * sigma * Eigen::Matrix3d::Identity())
                        .by(filter_.rowOf(handle), H));
    }
    Innovation in(filter_.covariance(), all);
    ASSERT_TRUE(in.factorise() && filter_.correct(in));
  }

  Random random_{3};
  Filter filter_;
  SE3 truth_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Handle> handles_, in_view_;
};

// To first order the second lap would be stretched by 1.05 m. What is left is of first order in how the
// points that come back are related to the pose.
TEST(Closure, LeavesTheMapRigid) {
  TwoLaps laps;
  laps.drive();
  EXPECT_LT(laps.worst(0), 0.01);
  EXPECT_GT(laps.worst(1), 9.0);
  EXPECT_LT(laps.stretch(1), 0.01);
  laps.close();
  for (const int lap : {0, 1}) {
    EXPECT_LT(laps.worst(lap), 0.4) << lap;
    EXPECT_LT(laps.stretch(lap), 0.35) << lap;
  }
}

} // namespace
} // namespace vi_ekf_slam::test

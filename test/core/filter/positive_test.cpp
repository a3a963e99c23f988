// Whatever a drive brings, the joint covariance stays one: with ones on its diagonal it has a Cholesky factor
// with at most 1e-9 added.

#include <algorithm>

#include "dense_filter.hpp"
#include "states.hpp"
#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/core/health/recovery.hpp"
#include "vi_ekf_slam/core/loops/fuse_matches.hpp"

namespace vi_ekf_slam::test {
namespace {

/// A drive with the default noise, in which everything happens that may.
class Eventful {
 public:
  explicit Eventful(unsigned seed) : random_(seed), scene_(start()) { refill(); }

  void frame() {
    for (int sample = 0; sample < 2; ++sample) {
      scene_.motion.propagate(scene_.filter, 0.05);
      ImuSample gyro;
      gyro.angular_velocity = Eigen::Vector3d(0.0, 0.0, 0.2) + random_.vector<3>(-0.05, 0.05);
      scene_.motion.process(scene_.filter, gyro);
      VelocitySample velocity;
      velocity.linear_velocity = Eigen::Vector3d(8.0, 0.0, 0.0) + random_.vector<3>(-0.5, 0.5);
      scene_.filter.correct(scene_.motion.measure(scene_.filter, velocity));
    }
    scene_.filter.settle();
    leaveView();
    const auto all = scene_.seen(random_, 1.0);
    if (!all.empty()) correctSeen(scene_.filter, all, scene_.model());
    refill();
  }

  const char* event() {
    const double dice = random_.uniform(0.0, 1.0);
    if (dice < 0.2) {
      const double gap = random_.uniform(3.0, 25.0);
      for (double t = 0.0; t < gap && isBridged(); t += 0.1) scene_.motion.propagate(scene_.filter, 0.1);
      return "gap";
    }
    if (dice < 0.35) {
      resetPose(scene_.filter, SE3::Exp(random_.vector<6>(-0.5, 0.5)),
                random_.uniform(0.01, 100.0) * spread());
      return "pose reset";
    }
    if (dice < 0.5) {
      resetPose(scene_.filter, SE3(), spread());
      scene_.motion.reset(scene_.filter, true);
      return "recovery";
    }
    if (dice < 0.75 && away_.size() > 6) {
      fuse();
      return "duplicates";
    }
    if (away_.size() < 3) return "nothing";
    for (int i = 0; i < 2; ++i) {
      const std::size_t k = anyOf(away_);
      scene_.filter.activate({away_[k]});
      scene_.filter.deactivate(away_[k]);
    }
    return "reactivation";
  }

  const Filter& filter() const { return scene_.filter; }

 private:
  static Scene start() {
    Scene scene{Filter(SE3(), 1e-6 * Matrix6d::Identity()), ConstantTwist({}), {}, {}};
    scene.motion.addTo(scene.filter);
    scene.scale =
        scene.filter.augment(Chart::kVector, Eigen::VectorXd::Zero(1), Eigen::MatrixXd::Constant(1, 1, 4e-4));
    scene.filter.closeCore();
    return scene;
  }

  /// The estimator begins anew where the orientation is not known to a radian (invariant_forecast.cpp).
  bool isBridged() const { return scene_.filter.covariance().diagonal().segment<3>(3).maxCoeff() < 1.0; }

  Matrix6d spread() {
    Vector6d variance;
    variance << Eigen::Vector3d::Constant(random_.uniform(1.0, 100.0)),
        Eigen::Vector3d::Constant(random_.uniform(1e-4, 0.1));
    return variance.asDiagonal();
  }

  std::size_t anyOf(const std::vector<Handle>& handles) {
    return static_cast<std::size_t>(random_.uniform(0.0, 0.999) * static_cast<double>(handles.size()));
  }

  void leaveView() {
    for (std::size_t i = scene_.points.size(); i-- > 0;) {
      const Eigen::Vector3d q =
          scene_.worldTCam().inverse() * scene_.filter.variables().point(scene_.points[i]);
      if (q.z() > 3.0 && random_.uniform(0.0, 1.0) < 0.93) continue;
      if (random_.uniform(0.0, 1.0) < 0.7) {
        scene_.filter.deactivate(scene_.points[i]);
        away_.push_back(scene_.points[i]);
      } else {
        scene_.filter.remove(scene_.points[i]);
      }
      scene_.points.erase(scene_.points.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }

  void refill() {
    while (scene_.points.size() < 15) {
      const Eigen::Vector3d q(random_.uniform(-6.0, 6.0), random_.uniform(-2.0, 2.0),
                              random_.uniform(5.0, 40.0));
      const auto found = scene_.model().triangulate(scene_.filter, exampleRig().camera.project(q));
      ASSERT_TRUE(found);
      scene_.points.push_back(scene_.filter.augment(Chart::kPoint, found->position, found->noise, found->by));
    }
  }

  /// What lies before the camera is said to be what was seen long ago.
  void fuse() {
    std::vector<Handle> before;
    std::vector<Duplicate> pairs;
    for (int i = 0; i < 3; ++i) {
      const std::size_t k = anyOf(away_);
      before.push_back(away_[k]);
      away_.erase(away_.begin() + static_cast<std::ptrdiff_t>(k));
    }
    scene_.filter.activate(before);
    for (const Handle handle : before) {
      const Eigen::Matrix3d noise = 0.01 * Eigen::Matrix3d::Identity();
      pairs.push_back(
          {scene_.filter.augment(
               Chart::kPoint, scene_.filter.variables().point(handle) + random_.vector<3>(-0.1, 0.1), noise),
           handle});
    }
    fuseDuplicates(scene_.filter, pairs, 1, 1e-3);
    for (const Duplicate& pair : pairs) scene_.filter.remove(pair.before);
    for (const Duplicate& pair : pairs) {
      scene_.filter.deactivate(pair.now);
      away_.push_back(pair.now);
    }
  }

  Random random_;
  Scene scene_;
  std::vector<Handle> away_;
};

TEST(JointCovariance, StaysOneWhateverHappens) {
  for (unsigned seed = 1; seed <= 40; ++seed) {
    Eventful drive(seed);
    for (int event = 0; event < 12; ++event) {
      for (int i = 0; i < 10; ++i) drive.frame();
      const char* what = drive.event();
      const Eigen::MatrixXd P = jointOf(drive.filter()), active = activatedOf(drive.filter());
      ASSERT_TRUE(isJointlyPositive(P)) << what << ", seed " << seed << ", event " << event;
      ASSERT_TRUE(isJointlyPositive(active)) << what << ", activated, seed " << seed << ", event " << event;
      ASSERT_LT(distance(P, P.transpose()), 1e-12 * P.cwiseAbs().maxCoeff());
    }
  }
}

/// A drive past points, half of which become inactive, all exactly where they are expected; before that pose
/// and points together may become unknown by `doubt`.
struct Doubted {
  explicit Doubted(const Matrix6d& doubt)
      : start(so3::Exp({0.1, -0.2, 0.3}), {30.0, -20.0, 5.0}),
        deferred(start, 1e-4 * Matrix6d::Identity()),
        dense(start, 1e-4 * Matrix6d::Identity()) {
    twist = add(Chart::kVector, Vector6d::Zero(), 0.1);
    deferred.closeCore();
    dense.closeCore();
    for (int i = 0; i < 20; ++i)
      points.push_back(add(Chart::kPoint, start.translation() + random.vector<3>(-20.0, 20.0), 0.01));
    drive(5);
    about = deferred.pose().translation();
    deferred.addNoise(0, doubt); // what is seen of the points from the body is as it was
    dense.addNoise(0, doubt);
    for (int i = 0; i < 10; ++i) {
      deferred.deactivate(points.back());
      dense.deactivate(points.back());
      points.pop_back();
    }
    drive(100);
    deferred.settleInactive();
    dense.settle();
  }

  Handle add(Chart chart, const Eigen::VectorXd& mean, double variance) {
    const Eigen::MatrixXd noise = randomCovariance(random, mean.size(), variance);
    const Handle handle = deferred.augment(chart, mean, noise);
    dense.augment(handle, chart, mean, noise, Eigen::MatrixXd::Zero(mean.size(), dense.covariance().rows()));
    return handle;
  }

  void drive(int frames) {
    for (int i = 0; i < frames; ++i) {
      const double dt = 0.1;
      CoreStep moves;
      moves.pose = deferred.pose() * SE3::Exp(dt * (Vector6d() << 8.0, 0.0, 0.0, 0.0, 0.0, 0.2).finished());
      moves.F = Eigen::MatrixXd::Identity(12, 12);
      moves.F.block<3, 3>(0, 3) = -so3::hat(moves.pose.translation() - deferred.pose().translation());
      moves.F.block<6, 6>(0, deferred.rowOf(twist)) = dt * Matrix6d::Identity();
      moves.Q = Eigen::MatrixXd::Zero(12, 12);
      moves.Q.bottomRightCorner<6, 6>() = 0.01 * dt * Matrix6d::Identity();
      deferred.propagate(moves);
      dense.propagate(moves);
      deferred.settle();
      std::vector<LinearMeasurement> all;
      for (const Handle point : points) {
        const Eigen::Matrix3d J = 50.0 * (Eigen::Matrix3d::Identity() + 0.3 * randomMatrix(random, 3, 3));
        all.push_back(LinearMeasurement(Eigen::Vector3d::Zero(), Eigen::Matrix3d::Identity())
                          .by(deferred.rowOf(point), J));
      }
      const DenseMeasurement z = denseOf(all, deferred.rows());
      Eigen::MatrixXd H = Eigen::MatrixXd::Zero(z.H.rows(), dense.covariance().rows());
      for (const Handle point : points)
        H.middleCols<3>(dense.of(point).row) = z.H.middleCols<3>(deferred.rowOf(point));
      correct(deferred, all);
      dense.correct(H, z.R, z.residual, {}, false);
    }
  }

  /// The dense filter's covariance in the order of the deferred one's.
  Eigen::MatrixXd ordered() {
    std::vector<Eigen::Index> rows;
    const auto append = [&](Handle handle) {
      const auto& v = dense.of(handle);
      for (Eigen::Index k = 0; k < v.mean.size(); ++k) rows.push_back(v.row + k);
    };
    for (const Handle handle : deferred.variables().handles()) append(handle);
    for (const InactiveVariable& variable : deferred.inactive().variables()) append(variable.handle);
    const auto size = static_cast<Eigen::Index>(rows.size());
    Eigen::MatrixXd result(size, size);
    for (Eigen::Index i = 0; i < size; ++i) {
      for (Eigen::Index j = 0; j < size; ++j)
        result(i, j) =
            dense.covariance()(rows[static_cast<std::size_t>(i)], rows[static_cast<std::size_t>(j)]);
    }
    return result;
  }

  /// The world shifted, or turned about where the doubt came.
  Eigen::MatrixXd gauge() const {
    const Eigen::Index n = deferred.rows();
    Eigen::MatrixXd N = Eigen::MatrixXd::Zero(n + deferred.inactive().covariance().rows(), 6);
    N.topRows<6>().setIdentity();
    N.block<3, 3>(0, 3) = -so3::hat(deferred.pose().translation() - about);
    for (std::size_t i = 0; i < deferred.inactive().variables().size(); ++i) {
      const Eigen::Vector3d x = deferred.inactive().variables()[i].linearised;
      N.middleRows<3>(n + deferred.inactive().rowOf(i)) << Eigen::Matrix3d::Identity(), -so3::hat(x - about);
    }
    return N;
  }

  Random random{11};
  SE3 start;
  Filter deferred;
  DenseFilter dense;
  Handle twist = 0;
  std::vector<Handle> points;
  Eigen::Vector3d about;
};

// What is common to pose and map is unknown to 300 m: none of it may leak into what is known, through 100
// frames of deferred updates. Since all that is measured does not depend on it, the covariance is what it is
// without, and what is common beside.
TEST(JointCovariance, IsExactThroughDeferredUpdatesWhereWhatIsCommonIsUnknown) {
  for (const double variance : {0.0, 1.0, 1e5}) {
    Matrix6d doubt = Matrix6d::Zero();
    doubt.diagonal() << Eigen::Vector3d::Constant(variance), Eigen::Vector3d::Constant(1e-7 * variance);
    Doubted without{Matrix6d(Matrix6d::Zero())}, with(doubt);
    const Eigen::MatrixXd joint = jointOf(with.deferred), N = with.gauge();
    EXPECT_GT(joint.diagonal().maxCoeff(), variance);
    const Eigen::MatrixXd expected = jointOf(without.deferred) + N * doubt * N.transpose();
    // What is common comes and goes in the periods of the core, and takes digits with it.
    EXPECT_LT(worstCorrelationError(joint, expected), variance > 1.0 ? 1e-6 : 1e-9) << variance;
    // The dense one, in whose steps what is common comes and goes, loses more by rounding.
    if (variance <= 1.0) {
      EXPECT_LT(worstCorrelationError(with.ordered(), expected), 1e-9) << variance;
    }
    EXPECT_TRUE(isJointlyPositive(joint)) << variance;
    EXPECT_TRUE(isJointlyPositive(activatedOf(with.deferred))) << variance;
  }
}

} // namespace
} // namespace vi_ekf_slam::test

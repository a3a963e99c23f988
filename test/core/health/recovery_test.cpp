#include "vi_ekf_slam/core/health/recovery.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "../filter/states.hpp"
#include "../road.hpp"
#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/simulation/consistency.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

// How the error answers to the body being shifted and turned by `covariance` along the world axes, the
// landmarks staying: dp and theta gain it, and what was known before stays.
TEST(Recovery, ResetsThePoseAsItsErrorIsDefined) {
  Random random(1);
  for (int run = 0; run < 5; ++run) {
    ConstantTwist motion({});
    Filter filter(SE3::Exp(random.vector<6>(-1.0, 1.0)), 0.01 * random.covariance<6>());
    motion.addTo(filter);
    filter.closeCore();
    std::vector<Handle> points;
    for (int i = 0; i < 4; ++i)
      points.push_back(
          filter.augment(Chart::kPoint, random.vector<3>(-9.0, 9.0), 0.1 * random.covariance<3>()));
    motion.propagate(filter, 0.5);
    filter.settle();
    const SE3 moved = SE3::Exp(random.vector<6>(-1.0, 1.0));
    const Matrix6d Q = random.covariance<6>();
    const SE3 expected = filter.pose() * moved;
    const auto alongWorld = [&filter] {
      const Eigen::MatrixXd axes = worldAxesOf(filter);
      return Eigen::MatrixXd(axes * filter.covariance() * axes.transpose());
    };
    const Eigen::MatrixXd before = alongWorld();
    std::vector<Eigen::Vector3d> positions;
    for (const Handle point : points) positions.push_back(filter.variables().point(point));
    const Eigen::Vector3d way = expected.translation() - filter.pose().translation();
    resetPose(filter, moved, Q);
    EXPECT_LT(distance(filter.pose().matrix(), expected.matrix()), 1e-12);
    for (std::size_t i = 0; i < points.size(); ++i)
      EXPECT_LT(distance(filter.variables().point(points[i]), positions[i]), 1e-12);
    // dp' = dp - [way]x theta; points and twist have the errors that they had.
    Eigen::MatrixXd T = Eigen::MatrixXd::Identity(before.rows(), before.cols());
    T.block<3, 3>(0, 3) = -so3::hat(way);
    Eigen::MatrixXd after = T * before * T.transpose();
    after.topLeftCorner<6, 6>() += Q;
    EXPECT_LT(relativeDistance(alongWorld(), after), 1e-9);
    EXPECT_TRUE(isPositive(filter.covariance(), 1e-13));
  }
}

struct Outcome {
  std::array<int, kDivergenceCount> counts{};
  double largest_nees = 0.0; ///< of the pose, 6 degrees of freedom
};

/// Drives on, and says what the frames reported.
Outcome drive(Road& road, InvariantEstimator& estimator, int frames) {
  Outcome outcome;
  for (int i = 0; i < frames; ++i) {
    const FrameReport report = road.feed(estimator);
    ++outcome.counts[static_cast<std::size_t>(report.divergence)];
    outcome.largest_nees =
        std::max(outcome.largest_nees, simulation::poseNees(road.truth(), estimator.state()).pose);
  }
  return outcome;
}

int count(const Outcome& outcome, Divergence divergence) {
  return outcome.counts[static_cast<std::size_t>(divergence)];
}

TEST(Recovery, IsNotCalledForOnAnOrdinaryDrive) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 40, kTypical);
    InvariantEstimator estimator = withRig();
    EXPECT_EQ(count(drive(road, estimator, 300), Divergence::kNone), 300) << seed;
  }
}

TEST(Recovery, FollowsADisplacedVehicleAndSaysSo) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 80, kTypical, 80.0);
    InvariantEstimator estimator = driven(road, 50);
    road.displace(SE3(so3::Exp({0.0, 0.0, 0.05}), {20.0, 1.0, 0.2}));
    const Outcome outcome = drive(road, estimator, 100);
    EXPECT_EQ(count(outcome, Divergence::kJump), 1) << seed;
    EXPECT_EQ(count(outcome, Divergence::kNone), 99) << seed;
    EXPECT_LT(positionError(estimator, road.truth()), 6.0) << seed;
    EXPECT_LT(outcome.largest_nees, 25.0) << seed;
  }
}

TEST(Recovery, LeavesADisplacedVehicleWhereItWasWhenTold) {
  InvariantConfig config = steadyTracks();
  config.recovery.jump_m = 0.0;
  Road road(1, 80, kTypical, 80.0);
  InvariantEstimator estimator = driven(road, 50, config);
  road.displace(SE3(Eigen::Matrix3d::Identity(), {20.0, 0.0, 0.0}));
  const Outcome outcome = drive(road, estimator, 100);
  EXPECT_EQ(count(outcome, Divergence::kNone), 100);
  EXPECT_GT(positionError(estimator, road.truth()), 15.0);
  EXPECT_GT(outcome.largest_nees, 100.0);
}

// Recorded drives begin with a pair that was matched wrongly: all is twice as far away as it is. Nothing but
// the pictures tells the motion here.
TEST(Recovery, TakesAFirstFrameThatIsWrongForNoJump) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 40, kTypical);
    InvariantEstimator estimator = withRig();
    for (int i = 0; i < 30; ++i) {
      StereoFrame frame = road.frame();
      for (StereoFeatureObservation& feature : frame.features) {
        StereoPixels& p = feature.pixels;
        if (i == 0) p[2] = 0.5 * (p[0] + p[2]);
      }
      EXPECT_EQ(estimator.process(frame).divergence, Divergence::kNone) << seed << " frame " << i;
      EXPECT_LT(positionError(estimator, road.pose()), 3.0) << seed << " frame " << i;
      road.move();
    }
  }
}

TEST(Recovery, KeepsItsCovarianceHonestWhileTheGyroLies) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Road road(seed, 60, kTypical);
    InvariantEstimator estimator = driven(road, 100);
    road.setGyroBias({0.0, 0.0, 1.0}); // rad/s, for 4 s
    const Outcome lying = drive(road, estimator, 40);
    EXPECT_LT(count(lying, Divergence::kNone), 40) << seed;
    road.setGyroBias(Eigen::Vector3d::Zero());
    drive(road, estimator, 30);
    const Outcome after = drive(road, estimator, 100);
    EXPECT_EQ(count(after, Divergence::kNone), 100) << seed;
    EXPECT_LT(after.largest_nees, 25.0) << seed;
    EXPECT_NEAR(estimator.state().twist[5], road.twist()[5], 0.05) << seed;
  }
}

TEST(Recovery, BuildsABrokenCovarianceAnew) {
  Road road(1, 40, kTypical);
  InvariantEstimator estimator = driven(road, 100);
  // Noise that is none: it leaves S positive and makes P - P H^T S^-1 H P negative.
  ImuSample lie = road.gyro();
  lie.covariance = -0.9 * estimator.state().twist_covariance.bottomRightCorner<3, 3>();
  estimator.process(lie);
  EXPECT_TRUE(isPositiveDefinite(estimator.state().pose_covariance));
  EXPECT_TRUE(isPositiveDefinite(estimator.state().twist_covariance));
  EXPECT_LT(positionError(estimator, road.pose()), 5.0);
  const Outcome outcome = drive(road, estimator, 100);
  EXPECT_EQ(count(outcome, Divergence::kCovariance), 1);
  EXPECT_EQ(count(outcome, Divergence::kNone), 99);
  EXPECT_LT(outcome.largest_nees, 25.0);
}

/// A car, seen at one of three rates, all of them with gyro and velocity at 30 Hz.
class RecoveryAtRate : public ::testing::TestWithParam<double> {
 protected:
  int perSecond() const { return static_cast<int>(GetParam()); }
  Road road(unsigned seed, std::size_t features, double farthest) const {
    Road road(seed, features, kTypical, farthest);
    road.setRates(GetParam(), 30 / perSecond());
    return road;
  }
};

TEST_P(RecoveryAtRate, IsNotCalledForOnAnOrdinaryDrive) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Road road = this->road(seed, 40, 40.0);
    InvariantEstimator estimator = withRig();
    const int frames = 30 * perSecond();
    EXPECT_EQ(count(drive(road, estimator, frames), Divergence::kNone), frames) << seed;
  }
}

TEST_P(RecoveryAtRate, FollowsADisplacedVehicleAtOnce) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Road road = this->road(seed, 80, 80.0);
    InvariantEstimator estimator = driven(road, 5 * perSecond());
    road.displace(SE3(so3::Exp({0.0, 0.0, 0.05}), {20.0, 1.0, 0.2}));
    const Outcome outcome = drive(road, estimator, 10 * perSecond());
    EXPECT_EQ(count(outcome, Divergence::kJump), 1) << seed;
    EXPECT_EQ(count(outcome, Divergence::kNone), 10 * perSecond() - 1) << seed;
    EXPECT_LT(positionError(estimator, road.truth()), 6.0) << seed;
    EXPECT_LT(outcome.largest_nees, 25.0) << seed;
  }
}

/// s until the first divergence is reported, of frames that `change` makes of the road's.
template <typename Change>
double timeToDivergence(Road& road, InvariantEstimator& estimator, Divergence& found, const Change& change) {
  const Stamp start = road.stamp();
  while (secondsBetween(start, road.stamp()) < 10.0) {
    const FrameReport report = road.feed(estimator, change);
    found = report.divergence;
    if (found != Divergence::kNone) return secondsBetween(start, report.stamp);
  }
  return 10.0;
}

// A front end that mixes up all its tracks: nothing of it was used, so nothing has misled the estimate.
TEST_P(RecoveryAtRate, IsNotMisledByNonsenseAndSaysSoAfterTheWindow) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Road road = this->road(seed, 60, 40.0);
    InvariantEstimator estimator = driven(road, 5 * perSecond());
    Divergence found = Divergence::kNone;
    Random random(seed);
    const double time = timeToDivergence(road, estimator, found, [&](StereoFrame& frame) {
      for (auto& f : frame.features) {
        const double u = random.uniform(100.0, 1200.0), v = random.uniform(0.0, 370.0);
        f.pixels = {u, v, u - random.uniform(2.0, 90.0), v};
      }
    });
    EXPECT_EQ(found, Divergence::kRejections) << seed;
    EXPECT_NEAR(time, 1.6, 0.3) << seed; // 80 % of 2 s
    const Matrix6d P = estimator.state().pose_covariance;
    EXPECT_LT((P.topLeftCorner<3, 3>().trace()), 3.0) << seed << ": as after 1.6 s without a frame";
    EXPECT_LT(simulation::poseNees(road.truth(), estimator.state()).pose, 25.0) << seed;
    const Outcome after = drive(road, estimator, 5 * perSecond());
    EXPECT_EQ(count(after, Divergence::kNone), 5 * perSecond()) << seed;
    EXPECT_LT(after.largest_nees, 25.0) << seed;
  }
}

// Every third frame says nothing that is true.
TEST_P(RecoveryAtRate, IsNotCalledForBySingleFramesOfNonsense) {
  Road road = this->road(1, 60, 40.0);
  InvariantEstimator estimator = driven(road, 2 * perSecond());
  Random random(1);
  int number = 0;
  for (int i = 0; i < 20 * perSecond(); ++i) {
    const FrameReport report = road.feed(estimator, [&](StereoFrame& frame) {
      if (number++ % 3 != 2) return;
      for (auto& f : frame.features) {
        const double u = random.uniform(100.0, 1200.0), v = random.uniform(0.0, 370.0);
        f.pixels = {u, v, u - random.uniform(2.0, 90.0), v};
      }
    });
    ASSERT_EQ(report.divergence, Divergence::kNone) << i;
  }
  EXPECT_LT(simulation::poseNees(road.truth(), estimator.state()).pose, 25.0);
}

// Most tracks are used, and yet what is rejected says that something is wrong: the tracks live for two
// frames, and of two in three the second one is elsewhere.
TEST_P(RecoveryAtRate, HearsWhatWasRejected) {
  InvariantConfig config = steadyTracks();
  config.max_tracked = 120; // the honest ones, and all others
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Road road = this->road(seed, 40, 40.0);
    InvariantEstimator estimator = driven(road, 5 * perSecond(), config);
    Divergence found = Divergence::kNone;
    FeatureId next = 1000000, first = next;
    int number = 0;
    Random random(seed);
    std::size_t used = 0, rejected = 0;
    const auto addLiars = [&](StereoFrame& frame) {
      const bool lie = number++ % 2 == 1;
      if (!lie) first = next;
      const std::size_t honest = frame.features.size();
      for (std::size_t i = 0; i < 2 * honest; ++i) {
        StereoFeatureObservation liar = frame.features[i % honest];
        liar.id = first + i;
        const double u = random.uniform(30.0, 90.0), v = random.uniform(30.0, 60.0);
        if (lie) liar.pixels += (i % 2 ? 1.0 : -1.0) * StereoPixels(u, v, u, v);
        frame.features.push_back(liar);
      }
      if (!lie) next = first + 2 * honest;
    };
    const Stamp start = road.stamp();
    while (found == Divergence::kNone && secondsBetween(start, road.stamp()) < 5.0) {
      const FrameReport report = road.feed(estimator, addLiars);
      used += report.used;
      rejected += report.rejected;
      found = report.divergence;
      if (found == Divergence::kNone) {
        EXPECT_FALSE(report.frame_rejected);
      }
    }
    EXPECT_EQ(found, Divergence::kInnovations)
        << seed << ": " << used << " used, " << rejected << " rejected";
    EXPECT_LT(secondsBetween(start, road.stamp()), 3.0) << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Hz, RecoveryAtRate, ::testing::Values(5.0, 10.0, 30.0));

} // namespace
} // namespace vi_ekf_slam

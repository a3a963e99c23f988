// A gap is integrated in steps, and one after which the heading may be anything is a new start.

#include <cmath>

#include "../road.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

/// rad, standard deviation.
double headingSigma(const Estimator& estimator) {
  return std::sqrt(estimator.state().pose_covariance.diagonal().tail<3>().maxCoeff());
}

/// Nothing for so long.
void wait(InvariantEstimator& estimator, double gap_s) {
  estimator.process(StereoFrame{estimator.state().stamp + fromSeconds(gap_s), {}});
}

/// The estimate after that.
InvariantEstimator after(InvariantEstimator estimator, double gap_s) {
  wait(estimator, gap_s);
  return estimator;
}

TEST(Gap, IsIntegratedInStepsOfATenthOfASecond) {
  Road road(1, 30, kTypical);
  const InvariantEstimator estimator = driven(road, 60);
  for (const double gap : {0.1, 0.5, 2.0, 7.0}) {
    InvariantEstimator stepwise = estimator;
    const int steps = static_cast<int>(std::lround(10.0 * gap));
    for (int i = 0; i < steps; ++i) wait(stepwise, 0.1);
    const StateEstimate a = after(estimator, gap).state(), b = stepwise.state();
    EXPECT_LT(distance(a.world_T_imu.matrix(), b.world_T_imu.matrix()), 1e-9) << gap;
    EXPECT_LT(relativeDistance(a.pose_covariance, b.pose_covariance), 1e-9) << gap;
    EXPECT_LT(relativeDistance(a.twist_covariance, b.twist_covariance), 1e-9) << gap;
  }
}

TEST(Gap, OfWhichHalfIsDrivenThroughInSmallerStepsIsTheSameToFirstOrder) {
  Road road(1, 30, kTypical);
  const InvariantEstimator estimator = driven(road, 60);
  InvariantEstimator fine = estimator;
  for (int i = 0; i < 300; ++i) wait(fine, 0.01);
  const StateEstimate a = after(estimator, 3.0).state(), b = fine.state();
  EXPECT_LT(distance(a.world_T_imu.matrix(), b.world_T_imu.matrix()), 1e-6);
  EXPECT_LT(relativeDistance(a.pose_covariance, b.pose_covariance), 0.01);
}

TEST(Gap, CanBeBridgedUntilTheHeadingIsNotKnown) {
  Road road(2, 30, kTypical);
  const InvariantEstimator estimator = driven(road, 60);
  double last = 0.0;
  int changes = 0;
  for (double gap = 0.5; gap <= 29.5; gap += 0.5) {
    const double sigma = headingSigma(after(estimator, gap));
    EXPECT_EQ(estimator.canBridge(gap), sigma <= 1.0) << gap << " s, " << sigma << " rad";
    EXPECT_GT(sigma, last);
    changes += last <= 1.0 && sigma > 1.0 ? 1 : 0;
    last = sigma;
  }
  EXPECT_EQ(changes, 1);
  EXPECT_TRUE(estimator.canBridge(0.0));
}

TEST(Gap, ThatIsAskedForChangesNothing) {
  Road road(3, 30, kTypical), same = road;
  InvariantEstimator asked = driven(road, 60), other = driven(same, 60);
  asked.canBridge(25.0);
  expectSame(asked.state(), other.state(), 0.0);
  road.feed(asked);
  same.feed(other);
  expectSame(asked.state(), other.state(), 0.0);
}

TEST(Gap, LosesWhatWasInView) {
  for (const double rate : {5.0, 10.0, 30.0}) {
    for (const double gap : {0.8, 1.2}) {
      Road road(4, 30, kTypical);
      road.setRates(rate, static_cast<int>(30.0 / rate));
      InvariantEstimator estimator = driven(road, static_cast<int>(4.0 * rate));
      StereoFrame next{estimator.state().stamp + fromSeconds(gap), {}};
      Road later = road;
      for (double t = 0.0; t < gap; t += 1.0 / 30.0) later.move();
      next.features = later.frame().features;
      const FrameReport report = estimator.process(next);
      EXPECT_EQ(report.used + report.rejected > 0, gap < 1.0) << rate << " " << gap;
    }
  }
}

/// What a system does that drives for 3 s, hears nothing for `gap` s, and goes on.
struct Told {
  SystemCounts counts;
  std::vector<std::string> reasons;
  double position = 0.0; ///< m from the origin, at the first frame after the gap
  bool finite = true;
};

Told driveThrough(double gap, EstimatorType type) {
  Config config;
  config.estimator = type;
  SlamSystem system(config);
  Told told;
  system.onReset([&](const std::string& reason, const PathEstimate&) { told.reasons.push_back(reason); });
  system.onFrame([&](const Output& output) {
    told.finite = told.finite && output.state.pose_covariance.allFinite();
    if (secondsBetween(fromSeconds(1003.0), output.state.stamp) >= gap - 0.05 && told.position == 0.0)
      told.position = output.state.world_T_imu.translation().norm();
  });
  system.setRig(exampleRig());
  Road road(5, 30, kTypical);
  const auto feed = [&] {
    system.add(road.gyro());
    system.add(road.velocity());
    system.add(road.frame());
    road.move();
  };
  for (int i = 0; i < 30; ++i) feed();
  for (double t = 0.0; t < gap - 0.05; t += 0.1) road.move();
  for (int i = 0; i < 30; ++i) feed();
  system.flush();
  told.counts = system.counts();
  return told;
}

TEST(SlamSystem, BridgesAGapAfterWhichTheHeadingIsKnown) {
  const Told told = driveThrough(5.0, EstimatorType::kInvariant);
  EXPECT_EQ(told.counts.gaps, 1u);
  EXPECT_EQ(told.counts.resets, 0u);
  EXPECT_TRUE(told.reasons.empty());
  EXPECT_GT(told.position, 40.0) << "8 s of 8 m/s, round a bend";
  EXPECT_TRUE(told.finite);
}

TEST(SlamSystem, BeginsAnewAfterAGapAfterWhichTheHeadingIsNotKnownAndSaysSo) {
  const Told told = driveThrough(20.0, EstimatorType::kInvariant);
  EXPECT_EQ(told.counts.gaps, 0u);
  EXPECT_EQ(told.counts.resets, 1u);
  ASSERT_EQ(told.reasons.size(), 1u);
  EXPECT_EQ(told.reasons[0].rfind("time jumped ahead by 20", 0), 0u) << told.reasons[0];
  EXPECT_NE(told.reasons[0].find("s, after which the orientation is not known"), std::string::npos)
      << told.reasons[0];
  EXPECT_LT(told.position, 1.0);
  EXPECT_TRUE(told.finite);
}

TEST(SlamSystem, BeginsAnewAfterALongerGapThanIsAllowed) {
  const Told told = driveThrough(31.0, EstimatorType::kInvariant);
  EXPECT_EQ(told.counts.resets, 1u);
  ASSERT_EQ(told.reasons.size(), 1u);
  EXPECT_EQ(told.reasons[0].find("orientation"), std::string::npos) << told.reasons[0];
}

TEST(SlamSystem, BridgesWithAnEstimatorThatDoesNotSay) {
  const Told told = driveThrough(20.0, EstimatorType::kPaper);
  EXPECT_EQ(told.counts.gaps, 1u);
  EXPECT_EQ(told.counts.resets, 0u);
}

/// Resets of a system that sees for 3 s, then nothing for 20 s while all else goes on, and sees again.
std::vector<std::string> resetsOfBlinded(bool gyro, bool velocity) {
  Config config;
  SlamSystem system(config);
  std::vector<std::string> reasons;
  system.onReset([&](const std::string& reason, const PathEstimate&) { reasons.push_back(reason); });
  system.setRig(exampleRig());
  Road road(6, 30, kTypical);
  for (int i = 0; i < 260; ++i) {
    if (gyro) system.add(road.gyro());
    if (velocity) system.add(road.velocity());
    StereoFrame frame = road.frame();
    if (i >= 30 && i < 230) frame.features.clear();
    system.add(frame);
    road.move();
  }
  system.flush();
  return reasons;
}

TEST(SlamSystem, BeginsAnewWhereItHasSeenNothingForSoLongThatTheHeadingIsNotKnown) {
  for (const bool velocity : {false, true}) {
    const auto reasons = resetsOfBlinded(false, velocity);
    ASSERT_EQ(reasons.size(), 1u);
    EXPECT_EQ(reasons[0].rfind("no feature for 20.1", 0), 0u) << reasons[0];
    EXPECT_NE(reasons[0].find("s, after which the orientation is not known"), std::string::npos);
  }
  EXPECT_TRUE(resetsOfBlinded(true, true).empty());
}

} // namespace
} // namespace vi_ekf_slam

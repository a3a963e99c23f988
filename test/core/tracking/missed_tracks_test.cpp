// A measurement between the two gates is left out and says nothing about its track; two in a row do.

#include <algorithm>

#include "../road.hpp"
#include "view.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

bool knows(const Estimator& estimator, FeatureId id) {
  const auto all = estimator.landmarks();
  return std::any_of(all.begin(), all.end(), [id](const LandmarkEstimate& l) { return l.id == id; });
}

void shift(StereoFrame& frame, FeatureId id, double px) {
  for (auto& feature : frame.features) {
    if (feature.id == id) feature.pixels += px * StereoPixels(1.0, 0.5, 1.0, 0.5);
  }
}

/// Before a frame, with a landmark in the middle of its view, and by how many px its measurement is missed.
class MissedTrack : public ::testing::Test {
 protected:
  void SetUp() override {
    // So slow that tracks stay in view for all of it.
    road_.setTwist(Vector6d::Unit(0) * 0.2);
    estimator_ = driven(road_, 40);
    for (const auto& feature : Road(road_).frame().features) {
      if (knows(estimator_, feature.id)) id_ = feature.id;
    }
    ASSERT_TRUE(knows(estimator_, id_));
    Road road(road_);
    double used = 0.0, rejected = 0.0;
    for (double px = 0.0; px < 40.0 && rejected == 0.0; px += 0.05) {
      Road ahead(road_);
      InvariantEstimator copy = estimator_;
      const std::size_t rejections =
          ahead.feed(copy, [&](StereoFrame& frame) { shift(frame, id_, px); }).rejected;
      if (rejections == 0) used = px;
      if (!knows(copy, id_)) rejected = px;
    }
    // Between the square roots of 11.3 and 21.1, whatever the standard deviation.
    EXPECT_NEAR(rejected / used, std::sqrt(21.108 / 11.345), 0.1);
    px_ = 0.5 * (used + rejected);
  }
  FrameReport feed(double px) {
    return road_.feed(estimator_, [&](StereoFrame& frame) { shift(frame, id_, px); });
  }

  Road road_{3, 40, {0.01, 0.001, 0.05}, 30.0};
  InvariantEstimator estimator_ = withRig();
  FeatureId id_ = 0;
  double px_ = 0.0;
};

TEST_F(MissedTrack, StaysInViewAndInTheMap) {
  const FrameReport missed = feed(px_);
  EXPECT_EQ(missed.rejected, 1u) << "it is not used";
  EXPECT_EQ(missed.removed, 0u);
  EXPECT_TRUE(knows(estimator_, id_));
  const FrameReport next = feed(0.0);
  EXPECT_EQ(next.rejected, 0u) << "it is used again";
  EXPECT_EQ(next.initialised, 0u);
  EXPECT_TRUE(knows(estimator_, id_));
  // And again: what comes between counts.
  EXPECT_EQ(feed(px_).rejected, 1u);
  EXPECT_TRUE(knows(estimator_, id_));
  EXPECT_EQ(feed(0.0).rejected, 0u);
}

TEST_F(MissedTrack, IsRejectedWhereItIsMissedAgain) {
  feed(px_);
  ASSERT_TRUE(knows(estimator_, id_));
  const FrameReport second = feed(px_);
  EXPECT_EQ(second.rejected, 1u);
  EXPECT_EQ(second.removed, 1u);
  EXPECT_FALSE(knows(estimator_, id_));
  EXPECT_GE(feed(0.0).rejected, 1u) << "in view it is not used again";
  EXPECT_FALSE(knows(estimator_, id_));
}

TEST_F(MissedTrack, IsRejectedAtOnceBeyondTheSecondGate) {
  const FrameReport report = feed(3.0 * px_);
  EXPECT_EQ(report.rejected, 1u);
  EXPECT_EQ(report.removed, 1u);
  EXPECT_FALSE(knows(estimator_, id_));
}

// Of one frame: a measurement is used, missed, or neither.
TEST(MissedMeasurement, IsNoneThatIsUsedOrOfASkippedFrame) {
  const FrameUpdate::Options options;
  for (const double px : {0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 30.0}) {
    View view(0.7, 5, 30);
    const StereoFrame frame = view.frameOf([&](FeatureId id, const Eigen::Vector3d& q) {
      const StereoPixels z = view.model.rig().camera.project(q);
      return id == 7 ? StereoPixels(z + px * StereoPixels(0.0, 1.0, 0.0, 1.0)) : z;
    });
    const FrameOutcome outcome = view.apply(options, frame);
    ASSERT_FALSE(outcome.skipped);
    ASSERT_EQ(outcome.missed.size(), outcome.used.size());
    for (std::size_t i = 0; i < outcome.used.size(); ++i)
      EXPECT_FALSE(outcome.used[i] && outcome.missed[i]) << px;
    EXPECT_EQ(std::count(outcome.used.begin(), outcome.used.end(), true), outcome.used[7] ? 30 : 29) << px;
    EXPECT_TRUE(px > 0.0 || outcome.used[7]);
    EXPECT_FALSE(px == 30.0 && (outcome.used[7] || outcome.missed[7]));
  }
}

} // namespace
} // namespace vi_ekf_slam

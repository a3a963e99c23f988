#include "vi_ekf_slam/core/tracking/track_status.hpp"

#include "view.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

constexpr FeatureId kTrack = 3;

/// Ten tracks where they are expected, but for one that is `off` m to the side.
StereoFrame frameAt(const View& view, double seconds, double off = 0.0) {
  StereoFrame frame = view.frameOf([&](FeatureId id, const Eigen::Vector3d& q) {
    return view.model.rig().camera.project(q + Eigen::Vector3d(id == kTrack ? off : 0.0, 0.0, 0.0));
  });
  frame.stamp = fromSeconds(seconds);
  return frame;
}

class TrackStatusTest : public ::testing::Test {
 protected:
  /// How many of a frame's tracks are rejected.
  std::size_t rejectedOf(const StereoFrame& frame) {
    const TrackStatus::Usable usable = status_.usable(view_.filter, view_.model, frame);
    EXPECT_EQ(usable.features.size() + usable.rejected + usable.invalid, frame.features.size());
    return usable.rejected;
  }

  View view_{0.5, 1, 10};
  TrackStatus status_;
};

TEST_F(TrackStatusTest, ARejectedTrackIsUsedAgainOnceItHasStoodForTwoSeconds) {
  EXPECT_EQ(rejectedOf(frameAt(view_, 0.0)), 0u);
  status_.reject(view_.filter, view_.model, frameAt(view_, 0.0), kTrack);
  for (int tenth = 1; tenth < 20; ++tenth) EXPECT_EQ(rejectedOf(frameAt(view_, 0.1 * tenth)), 1u) << tenth;
  EXPECT_EQ(rejectedOf(frameAt(view_, 2.05)), 0u);
  EXPECT_FALSE(status_.isRejected(kTrack));
  EXPECT_TRUE(status_.isSuspect(kTrack)); // and never enters the map that is kept
}

TEST_F(TrackStatusTest, OneThatMovesOnStaysRejected) {
  status_.reject(view_.filter, view_.model, frameAt(view_, 0.0), kTrack);
  for (int tenth = 1; tenth < 50; ++tenth)
    EXPECT_EQ(rejectedOf(frameAt(view_, 0.1 * tenth, 0.1 * tenth)), 1u) << tenth;
}

TEST_F(TrackStatusTest, AnIdThatLeftMayComeBackAsSomethingElse) {
  status_.reject(view_.filter, view_.model, frameAt(view_, 0.0), kTrack);
  StereoFrame without = frameAt(view_, 0.1);
  without.features.erase(without.features.begin() + kTrack);
  EXPECT_EQ(rejectedOf(without), 0u);
  EXPECT_EQ(rejectedOf(frameAt(view_, 0.2)), 0u);
  EXPECT_FALSE(status_.isSuspect(kTrack));
}

TEST_F(TrackStatusTest, BelievesTheMapAgainstOneFrameAndAgainstNonsenseForASecond) {
  const Associations seen{{{0, 0}, {1, 1}, {2, 2}}, {}, {}};
  const auto believes = [&](double seconds, double before) {
    return status_.believesMap(view_.filter, view_.model, frameAt(view_, seconds, 100.0 * seconds), seen,
                               fromSeconds(before));
  };
  EXPECT_FALSE(believes(0.1, 0.0)); // there is none yet
  status_.noteUse(fromSeconds(0.2));
  EXPECT_TRUE(believes(0.3, 0.2));
  status_.clear();
  status_.noteUse(fromSeconds(1.0));
  EXPECT_FALSE(believes(2.1, 2.0));
}

TEST_F(TrackStatusTest, DoesNotBelieveItWhereSkippedFramesAgreeOnAnotherView) {
  const Associations seen{{{0, 0}, {1, 1}, {2, 2}}, {}, {}};
  status_.noteUse(0);
  bool believed = true;
  for (int tenth = 1; tenth < 10 && believed; ++tenth)
    believed = status_.believesMap(view_.filter, view_.model, frameAt(view_, 0.1 * tenth), seen,
                                   fromSeconds(0.1 * (tenth - 1)));
  EXPECT_FALSE(believed);
}

} // namespace
} // namespace vi_ekf_slam

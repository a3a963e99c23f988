#include "vi_ekf_slam/core/tracking/new_landmarks.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace vi_ekf_slam {
namespace {

using Features = std::vector<std::size_t>;

constexpr Stamp kNow = 1000;
const StereoCamera kCamera{400.0, 400.0, 320.0, 200.0, 0.5}; // 640 x 400

/// A frame with a feature at each (u, v), with ids from 0 on.
StereoFrame frameAt(const std::vector<Eigen::Vector2d>& pixels) {
  StereoFrame frame;
  frame.stamp = kNow;
  for (const Eigen::Vector2d& p : pixels) {
    StereoFeatureObservation feature;
    feature.id = frame.features.size();
    feature.pixels << p.x(), p.y(), p.x(), p.y();
    frame.features.push_back(feature);
  }
  return frame;
}

Features choose(const StereoFrame& frame, const LandmarkMap& map, Features features, std::size_t most) {
  return chooseNewLandmarks(frame, kCamera, map, std::move(features), most);
}

LandmarkMap mapOf(const std::vector<FeatureId>& ids, Stamp last_seen, bool reactivated = false) {
  LandmarkMap map({});
  for (const FeatureId id : ids) map.add({id, 0, 1, 0, last_seen, reactivated});
  return map;
}

TEST(NewLandmarks, AreAllThatThereIsRoomFor) {
  const StereoFrame frame = frameAt({{600, 390}, {10, 10}, {320, 200}});
  EXPECT_EQ(choose(frame, LandmarkMap({}), {0, 1, 2}, 3), (Features{0, 1, 2}));
  EXPECT_EQ(choose(frame, LandmarkMap({}), {}, 3), Features{});
}

TEST(NewLandmarks, AreThoseNearestToTheMiddle) {
  const StereoFrame frame = frameAt({{600, 390}, {220, 200}, {10, 10}, {450, 200}});
  EXPECT_EQ(choose(frame, LandmarkMap({}), {0, 1, 2, 3}, 2), (Features{1, 3}));
}

TEST(NewLandmarks, KeepClearOfEachOther) {
  // Four points have a spacing of 253 px; 0 and 1 are 10 px apart.
  const StereoFrame frame = frameAt({{320, 200}, {330, 200}, {600, 200}, {30, 30}, {600, 390}});
  EXPECT_EQ(choose(frame, LandmarkMap({}), {0, 1, 2, 3, 4}, 4), (Features{0, 2, 3, 4}));
}

TEST(NewLandmarks, AreCrowdedWhereTheOthersDoNotSuffice) {
  const StereoFrame frame = frameAt({{330, 200}, {320, 200}, {322, 202}, {315, 200}});
  EXPECT_EQ(choose(frame, LandmarkMap({}), {0, 1, 2, 3}, 3), (Features{1, 2, 3}));
}

TEST(NewLandmarks, KeepClearOfWhatIsInViewAndLeaveItItsRoom) {
  const StereoFrame frame = frameAt({{320, 200}, {330, 200}, {600, 200}, {30, 30}});
  EXPECT_EQ(choose(frame, mapOf({0}, kNow), {1, 2, 3}, 2), Features{2});
  EXPECT_EQ(choose(frame, mapOf({0, 1}, kNow), {2, 3}, 2), Features{});
}

TEST(NewLandmarks, DoNotMindWhatIsOutOfViewOrFoundAgain) {
  const StereoFrame frame = frameAt({{320, 200}, {330, 200}, {600, 200}});
  EXPECT_EQ(choose(frame, mapOf({0}, kNow - 1), {1, 2}, 1), Features{1});
  EXPECT_EQ(choose(frame, mapOf({0}, kNow, true), {1, 2}, 1), Features{1});
}

TEST(NewLandmarks, DoNotDependOnTheOrderOfTheFeatures) {
  const StereoFrame frame = frameAt({{310, 200}, {330, 200}, {320, 190}, {320, 210}, {30, 30}});
  const Features chosen = choose(frame, LandmarkMap({}), {0, 1, 2, 3, 4}, 3);
  EXPECT_EQ(choose(frame, LandmarkMap({}), {4, 2, 0, 3, 1}, 3), chosen);
}

} // namespace
} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/slam/joint_map.hpp"

#include <gtest/gtest.h>

namespace vi_ekf_slam {
namespace {

constexpr Stamp kSecond = 1000000000;

JointMap mapThatKeeps(MapKeep keep) {
  LandmarkMap::Options options;
  options.keep = keep;
  return {options, PlaceRecognition::kNone};
}

/// At (1, 0, 0), of a body that has one landmark in view.
Filter filterWith(JointMap& map, FeatureId id) {
  Filter filter(SE3(Eigen::Matrix3d::Identity(), {1.0, 0.0, 0.0}), 0.01 * Matrix6d::Identity());
  filter.closeCore();
  Landmark landmark;
  landmark.id = id;
  landmark.variable =
      filter.augment(Chart::kPoint, Eigen::Vector3d(5.0, 2.0, 0.0), 0.04 * Eigen::Matrix3d::Identity());
  map.landmarks().add(landmark);
  return filter;
}

TEST(JointMap, KnowsLandmarksAndPathOfAFilter) {
  JointMap map = mapThatKeeps(MapKeep::kAll);
  Filter filter = filterWith(map, 7);
  map.addPose(filter, kSecond);
  map.loseAll(filter);
  EXPECT_TRUE(map.landmarks().active().empty());
  EXPECT_EQ(map.landmarks().inactiveCount(), 1U);
  const MapEstimate exact = map.exact(filter, kSecond)();
  ASSERT_EQ(exact.landmarks.size(), 1U);
  EXPECT_EQ(exact.landmarks[0].id, 7U);
  EXPECT_NEAR((exact.landmarks[0].position - Eigen::Vector3d(5.0, 2.0, 0.0)).norm(), 0.0, 1e-12);
  ASSERT_FALSE(map.path(filter, kSecond).nodes.empty());
  EXPECT_NEAR(map.path(filter, kSecond).nodes.front().now.translation().x(), 1.0, 1e-12);
  map.forgetPath();
  map.addPose(filter, 2 * kSecond);
  EXPECT_EQ(map.path(filter, 2 * kSecond).nodes.front().stamp, 2 * kSecond);
}

TEST(JointMap, KeepsNoPathWithoutAJointCovariance) {
  JointMap map = mapThatKeeps(MapKeep::kNone);
  Filter filter = filterWith(map, 7);
  map.addPose(filter, kSecond);
  EXPECT_FALSE(map.isKept());
  EXPECT_TRUE(filter.inactive().estimates(false).empty());
  EXPECT_TRUE(map.path(filter, kSecond).nodes.empty());
  map.loseAll(filter);
  EXPECT_EQ(map.landmarks().inactiveCount(), 0U);
}

TEST(JointMap, KeepsTheLastEstimatesOfAFilterThatIsGivenUp) {
  JointMap map = mapThatKeeps(MapKeep::kAll);
  Filter filter = filterWith(map, 7);
  map.addPose(filter, kSecond);
  map.archive(filter);
  Filter anew(SE3(), Matrix6d::Identity());
  anew.closeCore();
  EXPECT_TRUE(map.landmarks().active().empty());
  const MapEstimate exact = map.exact(anew, 2 * kSecond)();
  ASSERT_EQ(exact.landmarks.size(), 1U);
  EXPECT_EQ(exact.landmarks[0].id, 7U);
  EXPECT_NEAR(map.path(anew, 2 * kSecond).nodes.front().now.translation().x(), 1.0, 1e-12);
}

} // namespace
} // namespace vi_ekf_slam

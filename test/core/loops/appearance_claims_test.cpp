#include <gtest/gtest.h>

#include "../street.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/loops/fuse_matches.hpp"
#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kSigma = 0.2;               // px
constexpr FeatureId kFirst = 7, kTrack = 20; // ids: of the landmarks, and of what may be them
constexpr FeatureId kTracked = 3;

Descriptor lookOf(std::size_t i) {
  Descriptor look{};
  look.fill(static_cast<std::uint8_t>(0x11 * (i + 1)));
  return look;
}

/// Landmarks some 10 m ahead that are known to `sigma`, m, have been out of view, and are expected again;
/// beside them one that is tracked.
struct Expected {
  explicit Expected(double sigma = 0.01, std::size_t count = 1)
      : filter(SE3(), independentPose(1e-3, 1e-4)), map({}) {
    filter.closeCore();
    add(kTracked, {9.0, 0.0, 1.0}, 0.01);
    std::vector<FeatureId> ids;
    for (std::size_t i = 0; i < count; ++i) {
      points.push_back({10.0, 1.0 - 0.7 * static_cast<double>(i), 0.5});
      add(kFirst + i, points[i], sigma);
      ids.push_back(kFirst + i);
      map.deactivate(filter, 1);
    }
    map.expect(ids, 1);
  }

  /// New tracks of the same looks, offsets (m, world) from them; how many are recognised.
  std::size_t seenAt(const std::vector<Eigen::Vector3d>& offsets, bool any_tracked = true) {
    StereoFrame frame{2, {}, 0.0};
    std::vector<std::size_t> usable;
    const auto see = [&](FeatureId id, const Eigen::Vector3d& point, const Descriptor& look) {
      usable.push_back(frame.features.size());
      frame.features.push_back({id, rig.camera.project(rig.cam_T_imu * point), kSigma, 0.0, look});
    };
    if (any_tracked) see(kTracked, {9.0, 0.0, 1.0}, lookOf(9));
    for (std::size_t i = 0; i < offsets.size(); ++i) see(kTrack + i, points[i] + offsets[i], lookOf(i));
    filter.settle();
    claimExpected(filter, map, StereoModel(rig, {}), frame, usable);
    const auto is_track = [](const Landmark& l) { return l.id >= kTrack; };
    return static_cast<std::size_t>(std::count_if(map.active().begin(), map.active().end(), is_track));
  }
  double variance() const { return filter.worldCovariance(map.active().back().variable).trace() / 3.0; }

  void add(FeatureId id, const Eigen::Vector3d& at, double sigma) {
    Landmark landmark;
    landmark.id = id;
    landmark.variable = filter.augment(Chart::kPoint, at, isotropic(sigma));
    if (id != kTracked) landmark.descriptors.add(lookOf(id - kFirst));
    map.add(landmark);
  }

  StereoRig rig = exampleRig();
  std::vector<Eigen::Vector3d> points;
  Filter filter;
  LandmarkMap map;
};

TEST(AppearanceClaims, ALandmarkThatIsRecognisedHasTheErrorOfItsCorner) {
  Expected e;
  const double before = e.variance();
  EXPECT_EQ(e.seenAt({{0.0, 0.15, 0.0}}), 1u) << "within two sigma of a corner, 50 of a pixel";
  EXPECT_NEAR(e.variance() - before, kCornerSigma * kCornerSigma, 1e-4);
}

TEST(AppearanceClaims, OneThatIsElsewhereIsNotRecognised) {
  Expected e;
  EXPECT_EQ(e.seenAt({{0.0, 1.0, 0.0}}), 0u);
}

TEST(AppearanceClaims, WhereNothingIsTrackedThreeMustAgree) {
  const Eigen::Vector3d here = Eigen::Vector3d::Zero();
  EXPECT_EQ(Expected(0.01, 2).seenAt({here, here}, false), 0u);
  EXPECT_EQ(Expected(0.01, 3).seenAt({here, here, here}, false), 3u);
}

// Known to 0.5 m at 10 m it may be anywhere within 100 px, where others look like it.
TEST(AppearanceClaims, WhereTheirPlaceIsHardlyKnownThreeMustAgree) {
  const Eigen::Vector3d here = Eigen::Vector3d::Zero(), there(0.0, 0.6, 0.0);
  EXPECT_EQ(Expected(0.5, 1).seenAt({there}), 0u);
  EXPECT_EQ(Expected(0.5, 3).seenAt({here, here, here}), 3u);
}

TEST(AppearanceClaims, OneThatTheOthersContradictIsLeftOut) {
  Expected e(0.01, 4);
  // The pose is known to 0.5 m, so that 1 m is nothing for one of them by itself.
  e.filter.makeIndependent(1, Eigen::Matrix<double, 1, 1>(0.25));
  const Eigen::Vector3d here = Eigen::Vector3d::Zero();
  EXPECT_EQ(e.seenAt({here, here, here, {0.0, 1.0, 0.0}}), 3u);
  EXPECT_EQ(e.map.active().back().id, kFirst + 3);
}

} // namespace
} // namespace vi_ekf_slam::test

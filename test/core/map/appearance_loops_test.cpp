#include "vi_ekf_slam/core/map/appearance_loops.hpp"

#include <gtest/gtest.h>

#include "../street.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam::test {
namespace {

constexpr double kSigma = 0.2; // px

/// A landmark 10 m ahead that is known to a centimetre, has been out of view, and is expected again.
struct Expected {
  Expected() : filter(SE3(), independentPose(1e-3, 1e-4)), map({}) {
    filter.closeCore();
    Landmark landmark;
    landmark.id = 7;
    landmark.variable = filter.augment(Chart::kPoint, at, 1e-4 * Eigen::Matrix3d::Identity());
    landmark.descriptors.add(look);
    map.add(landmark);
    map.deactivate(filter, 0);
    map.expect({7}, 1);
  }

  /// A new track of the same look, `offset` (m, world) from it; the id of the landmark then.
  FeatureId seenAt(const Eigen::Vector3d& offset) {
    const StereoRig rig = exampleRig();
    const StereoModel model(rig, {});
    const StereoFrame frame{2, {{9, rig.camera.project(rig.cam_T_imu * (at + offset)), kSigma, 0.0, look}}, 0.0};
    filter.settle();
    AppearanceLoops::claim(filter, map, model, frame, {0});
    return map.active().front().id;
  }
  double variance() const { return filter.worldCovariance(map.active().front().variable).trace() / 3.0; }

  const Eigen::Vector3d at = {10.0, 1.0, 0.5};
  const Descriptor look = {1, 2, 3, 4};
  Filter filter;
  LandmarkMap map;
};

TEST(AppearanceLoops, ALandmarkThatIsRecognisedHasTheErrorOfItsCorner) {
  Expected e;
  const double before = e.variance();
  EXPECT_EQ(e.seenAt({0.0, 0.15, 0.0}), 9u) << "within two sigma of a corner, 50 of a pixel";
  EXPECT_NEAR(e.variance() - before, kCornerSigma * kCornerSigma, 1e-9);
}

TEST(AppearanceLoops, OneThatIsElsewhereIsNotRecognised) {
  Expected e;
  const double before = e.variance();
  EXPECT_EQ(e.seenAt({0.0, 1.0, 0.0}), 7u);
  EXPECT_EQ(e.variance(), before);
}

} // namespace
} // namespace vi_ekf_slam::test

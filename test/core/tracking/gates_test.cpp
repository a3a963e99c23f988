#include "view.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

constexpr double kOpen = 1e12; // a gate through which everything goes

/// Every gate but the one that is tested stands open.
FrameUpdate::Options openGates() {
  FrameUpdate::Options options;
  options.consensus = false;
  options.gate = options.plausible_gate = options.frame_gate = options.motion_gate = kOpen;
  return options;
}

/// Whether `frame` is used, which must show in the state.
bool isUsed(const FrameUpdate::Options& options, const View& start, const StereoFrame& frame) {
  View view = start;
  const FrameOutcome outcome = view.apply(options, frame);
  const bool used = usedOf(outcome) > 0;
  EXPECT_EQ(outcome.skipped, !used);
  EXPECT_EQ(distance(view.filter.pose().matrix(), start.filter.pose().matrix()) == 0.0, !used);
  EXPECT_EQ(distance(view.filter.covariance(), start.filter.covariance()) == 0.0, !used);
  return used;
}

TEST(FrameUpdate, RefusesAFrameThatWouldMoveTheTwistBeyondItsCovariance) {
  // All points agree that the body went 16 cm aside, which is 1.6 m/s of a twist known to 0.1 m/s. Point by
  // point the pixels are too bad to tell.
  const View view(3.0, 1, 60);
  const auto seenFrom = [&](double aside) {
    return view.frameOf([&](FeatureId, const Eigen::Vector3d& q) {
      return view.model.rig().camera.project(q - Eigen::Vector3d(aside, 0.0, 0.0));
    });
  };
  FrameUpdate::Options options = openGates();
  options.motion_gate = FrameUpdate::Options().motion_gate;
  EXPECT_TRUE(isUsed(options, view, seenFrom(0.02)));
  EXPECT_FALSE(isUsed(options, view, seenFrom(0.16)));
  EXPECT_TRUE(isUsed(openGates(), view, seenFrom(0.16)));
  options = FrameUpdate::Options();
  options.consensus = false;
  options.gate = options.plausible_gate;
  EXPECT_FALSE(isUsed(options, view, seenFrom(0.16)));
  options.motion_gate = kOpen;
  EXPECT_TRUE(isUsed(options, view, seenFrom(0.16))) << "no other gate tells";
}

TEST(FrameUpdate, RefusesAFrameWhoseInnovationsAreTooLargeAltogether) {
  const View view(1.0, 2, 40);
  const auto scattered = [&](double px) {
    Random random(3);
    return view.frameOf([&](FeatureId, const Eigen::Vector3d& q) -> StereoPixels {
      return view.model.rig().camera.project(q) + px * random.vector<4>(-1.0, 1.0);
    });
  };
  FrameUpdate::Options options = openGates();
  options.frame_gate = FrameUpdate::Options().frame_gate;
  EXPECT_TRUE(isUsed(options, view, scattered(2.0)));
  EXPECT_FALSE(isUsed(options, view, scattered(10.0)));
  EXPECT_TRUE(isUsed(openGates(), view, scattered(10.0)));
}

// With finer pixels so is a match that is wrong by less.
TEST(FrameUpdate, AgreesWithinTheNoiseOfThePixels) {
  for (const double sigma : {0.1, 1.0}) {
    const View start(sigma, 4, 40);
    for (const double off : {0.5, 6.0}) {
      View view = start;
      const FrameOutcome outcome = view.apply(
          FrameUpdate::Options(), view.frameOf([&](FeatureId id, const Eigen::Vector3d& q) -> StereoPixels {
            const StereoPixels aside(off * sigma, 0.0, off * sigma, 0.0);
            return view.model.rig().camera.project(q) + (id == 0 ? aside : StereoPixels::Zero().eval());
          }));
      EXPECT_EQ(usedOf(outcome), off < 1.0 ? 40 : 39) << sigma << " px, off by " << off;
      EXPECT_EQ(outcome.used[0], off < 1.0);
    }
  }
}

// It agrees with itself, so that no consensus tells.
TEST(FrameUpdate, RefusesTheOnlyKnownFeatureWhereItIsAsWrongAsThis) {
  const View view(1.0, 5, 1);
  const auto aside = [&](double px) {
    return view.frameOf([&](FeatureId, const Eigen::Vector3d& q) -> StereoPixels {
      return view.model.rig().camera.project(q) + px * StereoPixels(1.0, 0.0, 1.0, 0.0);
    });
  };
  EXPECT_TRUE(isUsed(FrameUpdate::Options(), view, aside(3.0)));
  EXPECT_FALSE(isUsed(FrameUpdate::Options(), view, aside(8.0)));
  FrameUpdate::Options options;
  options.frame_gate = kOpen;
  EXPECT_TRUE(isUsed(options, view, aside(8.0))) << "no other gate tells";
}

} // namespace
} // namespace vi_ekf_slam

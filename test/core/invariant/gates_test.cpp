#include <algorithm>

#include "states.hpp"
#include "vi_ekf_slam/core/invariant/frame_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

constexpr double kOpen = 1e12; // a gate through which everything goes

/// Every gate but the one that is tested stands open.
InvariantConfig openGates() {
  InvariantConfig config;
  config.consensus = false;
  config.gate = config.plausible_gate = config.frame_gate = config.motion_gate = kOpen;
  return config;
}

/// What `change(i, camera's point)` makes of the points that `state` expects.
template <typename Change>
StereoFrame frameOf(const StereoModel& model, const State& state, const Change& change) {
  StereoFrame frame;
  const SE3 cam_T_world = model.rig().cam_T_imu * state.pose().inverse();
  for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
    frame.features.push_back({i, change(i, cam_T_world * state.landmarks()[i].position)});
  }
  return frame;
}

/// Whether `frame` is used, which must show in the state.
bool isUsed(const InvariantConfig& config, const StereoModel& model, const State& start,
            const StereoFrame& frame) {
  State state = start;
  const FrameOutcome outcome =
      FrameUpdate(config, model).apply(state, frame, observe(model, state, frame), {});
  const bool used = std::count(outcome.used.begin(), outcome.used.end(), true) > 0;
  EXPECT_EQ(outcome.rejected, !used);
  EXPECT_EQ(distance(state.pose().matrix(), start.pose().matrix()) == 0.0, !used);
  EXPECT_EQ(distance(state.covariance(), start.covariance()) == 0.0, !used);
  return used;
}

TEST(FrameUpdate, RefusesAFrameThatWouldMoveTheTwistBeyondItsCovariance) {
  // All points agree that the body went 16 cm aside, which is 1.6 m/s of a twist known to 0.1 m/s. Point by
  // point the pixels are too bad to tell.
  const StereoModel model(exampleRig(), 3.0, 0.5);
  const State state = seenState(model, 1, 60);
  const auto seenFrom = [&](double aside) {
    return frameOf(model, state, [&](std::size_t, const Eigen::Vector3d& q) {
      return model.rig().camera.project(q - Eigen::Vector3d(aside, 0.0, 0.0));
    });
  };
  InvariantConfig config = openGates();
  config.motion_gate = InvariantConfig().motion_gate;
  EXPECT_TRUE(isUsed(config, model, state, seenFrom(0.02)));
  EXPECT_FALSE(isUsed(config, model, state, seenFrom(0.16)));
  EXPECT_TRUE(isUsed(openGates(), model, state, seenFrom(0.16)));
  config = InvariantConfig();
  config.consensus = false;
  config.gate = config.plausible_gate;
  EXPECT_FALSE(isUsed(config, model, state, seenFrom(0.16)));
  config.motion_gate = kOpen;
  EXPECT_TRUE(isUsed(config, model, state, seenFrom(0.16))) << "no other gate tells";
}

TEST(FrameUpdate, RefusesAFrameWhoseInnovationsAreTooLargeAltogether) {
  const StereoModel model(exampleRig(), 1.0, 0.5);
  const State state = seenState(model, 2, 40);
  const auto scattered = [&](double px) {
    Random random(3);
    return frameOf(model, state, [&](std::size_t, const Eigen::Vector3d& q) -> StereoPixels {
      return model.rig().camera.project(q) + px * random.vector<4>(-1.0, 1.0);
    });
  };
  InvariantConfig config = openGates();
  config.frame_gate = InvariantConfig().frame_gate;
  EXPECT_TRUE(isUsed(config, model, state, scattered(2.0)));
  EXPECT_FALSE(isUsed(config, model, state, scattered(10.0)));
  EXPECT_TRUE(isUsed(openGates(), model, state, scattered(10.0)));
}

} // namespace
} // namespace vi_ekf_slam::invariant

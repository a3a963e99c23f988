#include <algorithm>
#include <set>

#include "road.hpp"

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

constexpr FeatureId kNobody = ~FeatureId{0};
constexpr double kRounding = 1e-11; // which row a landmark has is felt in the last digits

/// A drive of 40 frames, and then the same frame by frame for two filters.
class Pair {
 public:
  explicit Pair(unsigned seed) : road_(seed, 30, kTypical), first(driven(road_, 40)), second(first) {}

  /// The id of a landmark that is seen again in the next frame.
  FeatureId known() const {
    const StereoFrame frame = Road(road_).frame();
    std::set<FeatureId> map;
    for (const LandmarkEstimate& l : first.landmarks()) map.insert(l.id);
    for (auto feature = frame.features.rbegin(); feature != frame.features.rend(); ++feature) {
      if (map.count(feature->id)) return feature->id;
    }
    return kNobody;
  }

  /// `change(frame, 0 or 1)` on the frames of the two.
  template <typename Change>
  std::pair<FrameReport, FrameReport> feed(const Change& change) {
    const GyroSample gyro = road_.gyro();
    const VelocitySample velocity = road_.velocity();
    const StereoFrame frame = road_.frame();
    FrameReport reports[2];
    InvariantEstimator* estimators[2] = {&first, &second};
    for (int i = 0; i < 2; ++i) {
      estimators[i]->process(gyro);
      estimators[i]->process(velocity);
      StereoFrame own = frame;
      change(own, i);
      reports[i] = estimators[i]->process(own);
    }
    road_.move();
    return {reports[0], reports[1]};
  }

 private:
  Road road_;

 public:
  InvariantEstimator first, second;
};

void erase(StereoFrame& frame, FeatureId id) {
  frame.features.erase(std::remove_if(frame.features.begin(), frame.features.end(),
                                      [id](const StereoFeatureObservation& f) { return f.id == id; }),
                       frame.features.end());
}

void displace(StereoFrame& frame, FeatureId id) {
  for (auto& feature : frame.features) {
    if (feature.id == id) feature.pixels += StereoPixels(40.0, 25.0, 40.0, 25.0);
  }
}

TEST(Outcasts, AreNotUsedAgainWhileTheyAreInView) {
  Pair pair(500);
  const FeatureId liar = pair.known();
  ASSERT_NE(liar, kNobody);
  const auto at = pair.feed([&](StereoFrame& frame, int i) {
    if (i == 0) displace(frame, liar);
    if (i == 1) erase(frame, liar);
  });
  EXPECT_EQ(at.first.used, at.second.used);
  EXPECT_EQ(at.first.rejected, at.second.rejected + 1);
  // Its later frames are right, and it makes no difference whatever that it is there.
  for (int k = 0; k < 5; ++k) {
    const auto [with, without] = pair.feed([&](StereoFrame& frame, int i) {
      if (i == 1) erase(frame, liar);
    });
    if (with.features == without.features) break; // out of view
    EXPECT_GE(k, 0);
    EXPECT_EQ(with.rejected, without.rejected + 1) << k;
    EXPECT_EQ(with.used, without.used) << k;
    EXPECT_EQ(with.initialised, without.initialised) << k;
    EXPECT_EQ(with.landmarks, without.landmarks) << k;
    EXPECT_EQ(with.features, with.invalid + with.used + with.rejected + with.initialised) << k;
    expectSame(pair.first.state(), pair.second.state(), kRounding);
  }
}

TEST(Outcasts, AreForgottenOnceTheyAreGone) {
  Pair pair(500);
  const FeatureId liar = pair.known();
  ASSERT_NE(liar, kNobody);
  pair.feed([&](StereoFrame& frame, int i) {
    if (i == 0) displace(frame, liar);
    if (i == 1) erase(frame, liar);
  });
  pair.feed([&](StereoFrame& frame, int) { erase(frame, liar); }); // away for one frame
  StereoFrame seen;
  const auto [returned, also] = pair.feed([&](StereoFrame& frame, int) { seen = frame; });
  ASSERT_TRUE(std::any_of(seen.features.begin(), seen.features.end(),
                          [&](const StereoFeatureObservation& f) { return f.id == liar; }));
  EXPECT_EQ(returned.initialised, also.initialised);
  EXPECT_EQ(returned.rejected, also.rejected);
  EXPECT_GE(returned.initialised, 1u);
  expectSame(pair.first.state(), pair.second.state(), kRounding);
}

TEST(Outcasts, AreNotMadeOfAFrameThatIsRefusedAsAWhole) {
  // Nothing speaks against its single features: they start afresh, and are used in the next frame.
  Road road(510, 30, {0.1, 0.01, 0.7}, 20.0);
  InvariantConfig config;
  config.velocity_sigma = 0.1;
  config.gyro_sigma = 0.01;
  Ahead now = ahead(road, 50, config);
  const StereoCamera camera = exampleRig().camera;
  for (auto& feature : now.frame.features) {
    feature.pixels = camera.project(*camera.triangulate(feature.pixels) + Eigen::Vector3d(0.0, 0.0, 2.5));
  }
  const FrameReport refused = now.estimator.process(now.frame);
  ASSERT_TRUE(refused.frame_rejected);
  EXPECT_EQ(refused.used, 0u);
  EXPECT_EQ(refused.initialised, 30u);
  // The points stay where they were seen, and the car goes on.
  const StereoFrame before = now.frame;
  road.move();
  now.estimator.process(road.gyro());
  now.estimator.process(road.velocity());
  StereoFrame next{road.frame().stamp, {}};
  const SE3 moved = SE3::Exp(0.1 * road.twist());
  const SE3 cam_T_imu = exampleRig().cam_T_imu;
  for (const auto& feature : before.features) {
    const Eigen::Vector3d q = *camera.triangulate(feature.pixels);
    next.features.push_back(
        {feature.id, camera.project(cam_T_imu * moved.inverse() * cam_T_imu.inverse() * q)});
  }
  EXPECT_GE(now.estimator.process(next).used, 28u);
}

} // namespace
} // namespace vi_ekf_slam::invariant

// A track is lost (not in the frame), rejected (contradicts the static world) or skipped (the frame was not
// used).

#include <algorithm>
#include <set>
#include <vector>

#include "../road.hpp"

namespace vi_ekf_slam {
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
    const ImuSample gyro = road_.gyro();
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

TEST(RejectedTrack, IsNotUsedAgainWhileItIsInView) {
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

TEST(RejectedTrack, IsForgottenOnceItIsGone) {
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

std::set<FeatureId> idsOf(const std::vector<LandmarkEstimate>& landmarks) {
  std::set<FeatureId> ids;
  for (const LandmarkEstimate& l : landmarks) ids.insert(l.id);
  return ids;
}

/// All ids that an estimator will ever show: published, exact and saved.
std::set<FeatureId> idsIn(const Estimator& estimator) {
  std::set<FeatureId> ids = idsOf(estimator.landmarks());
  ids.merge(idsOf(estimator.exactMap()().landmarks));
  if (!estimator.keepsJointMap()) return ids;
  for (const SavedLandmark& l : estimator.savedMap()().landmarks) ids.insert(l.id);
  return ids;
}

/// Ids of the road that it had in view for all of `frames`, of which `estimator` saw all.
std::set<FeatureId> longTracked(Road& road, InvariantEstimator& estimator, int frames) {
  std::set<FeatureId> tracked;
  for (int i = 0; i < frames; ++i) {
    std::set<FeatureId> now;
    road.feed(estimator, [&](StereoFrame& frame) {
      for (const StereoFeatureObservation& f : frame.features) now.insert(f.id);
    });
    if (i == 0) tracked = now;
    std::set<FeatureId> still;
    for (const FeatureId id : tracked) {
      if (now.count(id)) still.insert(id);
    }
    tracked.swap(still);
  }
  return tracked;
}

class RejectedTrackAtRate : public ::testing::TestWithParam<double> {};

// A car that stood, was tracked for long, and drives off.
TEST_P(RejectedTrackAtRate, NeverEntersTheMapHoweverLongItWasTracked) {
  const int per_second = static_cast<int>(GetParam());
  for (const MapKeep keep : {MapKeep::kNone, MapKeep::kGood, MapKeep::kAll}) {
    InvariantConfig config = steadyTracks();
    config.map.keep = keep;
    Road road(20, 40, {0.1, 0.01, 0.5});
    road.setRates(per_second, 30 / per_second);
    InvariantEstimator estimator = withRig(config);
    for (int i = 0; i < per_second; ++i) road.feed(estimator);
    const std::set<FeatureId> tracked = longTracked(road, estimator, 3 * per_second / 2);
    ASSERT_GE(tracked.size(), 5u);
    const std::set<FeatureId> known = idsIn(estimator);
    std::set<FeatureId> liars;
    for (const FeatureId id : tracked) {
      if (liars.size() < 3) liars.insert(id);
      EXPECT_TRUE(known.count(id)) << id;
    }
    double away = 0.0;
    const auto drivesOff = [&](StereoFrame& frame) {
      away += 60.0 / per_second; // px
      for (StereoFeatureObservation& f : frame.features) {
        if (liars.count(f.id)) f.pixels += away * StereoPixels(1.0, 0.5, 1.0, 0.5);
      }
    };
    for (int i = 0; i < 8 * per_second; ++i) {
      const FrameReport report = road.feed(estimator, drivesOff);
      ASSERT_FALSE(report.frame_rejected);
      if (i < per_second / 2) continue; // by when it is 30 px off
      const std::set<FeatureId> map = idsIn(estimator);
      for (const FeatureId id : liars) ASSERT_FALSE(map.count(id)) << id << " in frame " << i;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Hz, RejectedTrackAtRate, ::testing::Values(5.0, 10.0, 30.0));

// Every other place that a landmark in view may leave to.
TEST(RejectedTrack, NeverEntersTheMapWhereAllThatIsInViewLeaves) {
  Road road(21, 40, {0.1, 0.01, 0.5});
  InvariantEstimator estimator = driven(road, 30);
  const FeatureId liar = *longTracked(road, estimator, 12).begin();
  ASSERT_TRUE(idsIn(estimator).count(liar));
  bool in_view = false;
  const FrameReport report = road.feed(estimator, [&](StereoFrame& frame) {
    displace(frame, liar);
    in_view = std::any_of(frame.features.begin(), frame.features.end(),
                          [&](const auto& f) { return f.id == liar; });
  });
  ASSERT_TRUE(in_view);
  EXPECT_GE(report.rejected, 1u);
  for (int i = 0; i < 15; ++i) road.move(); // a gap in which every track is lost
  road.feed(estimator);
  EXPECT_FALSE(idsIn(estimator).count(liar));
}

// Half of what is in view rides on a lorry for a fifth of a second, nearly as fast, and takes the other half
// for what moves. The car is so slow that no new tracks come, so that no id is ever free again.
TEST(RejectedTrack, IsUsedAgainOnceItHasStoodStill) {
  for (const double share : {0.5, 0.6, 0.7}) {
    Road road(22, 40, {0.1, 0.01, 0.5}, 30.0);
    road.setTwist(Vector6d::Unit(0) * 0.2);
    InvariantEstimator estimator = driven(road, 30);
    const StereoCamera camera = exampleRig().camera;
    double ahead = 0.0;
    const auto lorry = [&](StereoFrame& frame) {
      ahead += 0.12;
      const auto riding = static_cast<std::size_t>(share * static_cast<double>(frame.features.size()));
      for (std::size_t i = 0; i < riding; ++i) {
        StereoPixels& z = frame.features[i].pixels;
        z = camera.project(*camera.triangulate(z) + Eigen::Vector3d(0.5 * ahead, 0.0, ahead));
      }
    };
    std::size_t rejected = 0;
    for (int i = 0; i < 2; ++i) rejected = std::max(rejected, road.feed(estimator, lorry).rejected);
    EXPECT_GE(rejected, 5u) << share;
    FrameReport report;
    for (int i = 0; i < 50; ++i) report = road.feed(estimator);
    EXPECT_GE(report.used, 34u) << share << ", " << rejected << " rejected";
    EXPECT_LE(report.rejected, 4u) << share;
  }
}

// It may be used again; into the map it does not go.
TEST(RejectedTrack, IsNotForTheMapAfterItHasStoodStillEither) {
  Road road(23, 40, {0.1, 0.01, 0.5}, 30.0);
  road.setTwist(Vector6d::Unit(0) * 0.2);
  InvariantEstimator estimator = driven(road, 20);
  const FeatureId liar = *longTracked(road, estimator, 12).begin();
  road.feed(estimator, [&](StereoFrame& frame) { displace(frame, liar); });
  ASSERT_FALSE(idsIn(estimator).count(liar));
  for (int i = 0; i < 40; ++i) road.feed(estimator);
  EXPECT_TRUE(idsIn(estimator).count(liar)) << "in view, and used";
  const auto leaves = [&](StereoFrame& frame) { erase(frame, liar); };
  for (int i = 0; i < 2; ++i) road.feed(estimator, leaves);
  EXPECT_FALSE(idsIn(estimator).count(liar));
}

/// The whole map, bit by bit.
void expectSameMap(const std::vector<LandmarkEstimate>& a, const std::vector<LandmarkEstimate>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].id, b[i].id);
    EXPECT_EQ(a[i].position, b[i].position);
    EXPECT_EQ(a[i].covariance, b[i].covariance);
  }
}

/// All points of `frame` as if the car had jumped by `jump` m: they agree with each other, and not with it.
void jumpAhead(StereoFrame& frame, double jump) {
  const StereoCamera camera = exampleRig().camera;
  for (auto& feature : frame.features)
    feature.pixels = camera.project(*camera.triangulate(feature.pixels) + Eigen::Vector3d(0.0, 0.0, jump));
}

InvariantConfig precise() {
  InvariantConfig config = steadyTracks();
  config.motion.velocity_sigma = 0.1;
  config.motion.gyro_sigma = 0.01;
  return config;
}

// To the last bit: all that is known of a landmark, and what the next frame makes of it.
TEST(SkippedFrame, IsAsIfItHadNotBeen) {
  Road road(510, 30, {0.1, 0.01, 0.7}, 20.0);
  Ahead now = ahead(road, 50, precise());
  InvariantEstimator without = now.estimator;
  StereoFrame wrong = now.frame;
  jumpAhead(wrong, 2.5);
  for (int i = 0; i < 8; ++i) {
    const FrameReport report = now.estimator.process(wrong);
    ASSERT_TRUE(report.frame_rejected) << i;
    EXPECT_EQ(report.initialised + report.removed + report.used, 0u) << i;
    EXPECT_GE(report.landmarks, 25u);
    expectSame(now.estimator.state(), without.state(), 0.0);
    expectSameMap(now.estimator.landmarks(), without.landmarks());
    expectSameMap(now.estimator.exactMap()().landmarks, without.exactMap()().landmarks);
  }
  const FrameReport after = now.estimator.process(now.frame), expected = without.process(now.frame);
  EXPECT_GE(after.used, 20u);
  EXPECT_EQ(after.used, expected.used);
  EXPECT_EQ(after.rejected, expected.rejected);
  EXPECT_EQ(after.initialised, expected.initialised);
  EXPECT_EQ(after.removed, expected.removed);
  expectSame(now.estimator.state(), without.state(), 0.0);
  expectSameMap(now.estimator.exactMap()().landmarks, without.exactMap()().landmarks);
}

/// Every pixel far off, to one side or the other.
void scatter(StereoFrame& frame) {
  for (auto& feature : frame.features) {
    const double u = 200.0 + 30.0 * static_cast<double>(feature.id % 7);
    feature.pixels += (feature.id % 2 ? u : -u) * StereoPixels(1.0, 0.5, 1.0, 0.5);
  }
}

// The tracks go on as what they were.
TEST(SkippedFrame, IsForgottenByTheNextOne) {
  for (const double rate : {5.0, 10.0, 30.0}) {
    Road road(510, 60, {0.1, 0.01, 0.7}, 40.0);
    road.setRates(rate, static_cast<int>(30.0 / rate));
    InvariantEstimator estimator = driven(road, static_cast<int>(5.0 * rate), precise());
    const std::set<FeatureId> before = idsOf(estimator.landmarks());
    for (int i = 0; i < static_cast<int>(0.8 * rate); ++i) {
      const FrameReport report = road.feed(estimator, scatter);
      ASSERT_TRUE(report.frame_rejected) << rate << " " << i;
      ASSERT_EQ(report.divergence, Divergence::kNone) << rate << " " << i;
      EXPECT_EQ(idsOf(estimator.landmarks()), before) << rate << " " << i;
    }
    std::size_t still_known = 0;
    const FrameReport report = road.feed(estimator, [&](StereoFrame& frame) {
      for (const auto& f : frame.features) still_known += before.count(f.id);
    });
    EXPECT_FALSE(report.frame_rejected) << rate;
    EXPECT_GE(still_known, 20u) << rate;
    EXPECT_GE(report.used + 3, still_known) << rate;
  }
}

// One bad track that is all that is left of the view before says nothing about the others.
TEST(SkippedFrame, IsNotMadeOfFewTracksWhileOthersBegin) {
  for (const std::size_t bad : {1u, 3u, 6u}) {
    Road road(30, 40, kTypical);
    InvariantEstimator estimator = driven(road, 40);
    std::set<FeatureId> stay;
    // The front end starts anew: all tracks get other ids, but for some, and these are wrong from now on.
    const auto restarted = [&](StereoFrame& frame) {
      for (auto& feature : frame.features) {
        if (stay.count(feature.id))
          feature.pixels += StereoPixels(60.0, 25.0, 60.0, 25.0);
        else
          feature.id += 1000000;
      }
    };
    for (const auto& feature : Road(road).frame().features) {
      if (stay.size() < bad && idsOf(estimator.landmarks()).count(feature.id)) stay.insert(feature.id);
    }
    ASSERT_EQ(stay.size(), bad);
    const FrameReport first = road.feed(estimator, restarted);
    EXPECT_GE(first.initialised, 25u) << bad;
    EXPECT_GE(road.feed(estimator, restarted).used, 20u) << bad;
  }
}

} // namespace
} // namespace vi_ekf_slam

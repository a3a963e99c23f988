// Who listens does not change what is told.

#include <memory>
#include <vector>

#include "../../sanitized.hpp"
#include "../road.hpp"

namespace vi_ekf_slam {
namespace {

using namespace test;

/// Everything that an estimator publishes.
void readAll(const Estimator& estimator) {
  (void)estimator.state();
  (void)estimator.landmarks();
  (void)estimator.canBridge(3.0);
  (void)estimator.exactMap()().landmarks;
  if (const auto saved = estimator.savedMap()) (void)saved();
}

void expectSameWhole(const InvariantEstimator& a, const InvariantEstimator& b) {
  expectSame(a.state(), b.state(), 0.0);
  for (const bool exact : {false, true}) {
    const auto map_a = exact ? a.exactMap()().landmarks : a.landmarks(),
               map_b = exact ? b.exactMap()().landmarks : b.landmarks();
    ASSERT_EQ(map_a.size(), map_b.size());
    for (std::size_t i = 0; i < map_a.size(); ++i) {
      ASSERT_EQ(map_a[i].id, map_b[i].id);
      ASSERT_EQ(map_a[i].position, map_b[i].position) << exact;
      ASSERT_EQ(map_a[i].covariance, map_b[i].covariance) << exact;
    }
  }
  const SavedMap saved_a = a.savedMap()(), saved_b = b.savedMap()();
  EXPECT_EQ(saved_a.covariance, saved_b.covariance);
  ASSERT_EQ(saved_a.variables.size(), saved_b.variables.size());
  for (std::size_t i = 0; i < saved_a.variables.size(); ++i)
    EXPECT_EQ(saved_a.variables[i].mean, saved_b.variables[i].mean);
}

/// Two drives along the same road, of which one is read after every measurement.
void expectReadersToBeHarmless(InvariantEstimator read, InvariantEstimator alone, Road road, int frames) {
  for (int i = 0; i < frames; ++i) {
    const ImuSample gyro = road.gyro();
    const VelocitySample velocity = road.velocity();
    const StereoFrame frame = road.frame();
    road.move();
    read.process(gyro);
    readAll(read);
    read.process(velocity);
    readAll(read);
    const FrameReport a = read.process(frame);
    readAll(read);
    alone.process(gyro);
    alone.process(velocity);
    const FrameReport b = alone.process(frame);
    ASSERT_EQ(a.used, b.used) << i;
    ASSERT_EQ(a.revisited, b.revisited) << i;
    ASSERT_EQ(a.nis, b.nis) << i;
  }
  expectSameWhole(read, alone);
}

TEST(Readers, ChangeNothing) {
  InvariantConfig config = steadyTracks();
  config.map.max_landmarks = 60; // so that some are marginalised and archived
  const InvariantEstimator start = withRig(config);
  expectReadersToBeHarmless(start, start, Road(1, 25, kTypical), kSanitized ? 30 : 150);
}

TEST(Readers, ChangeNothingWhereLandmarksReturn) {
  Road road(6, 40, kTypical);
  const auto map = std::make_shared<const SavedMap>(driven(road, 60).savedMap()());
  InvariantEstimator resumed = withRig();
  resumed.resumeFrom(map, "map", 30.0);
  expectReadersToBeHarmless(resumed, resumed, road, 40);
  InvariantEstimator elsewhere = withRig();
  elsewhere.relocaliseIn(map);
  expectReadersToBeHarmless(elsewhere, elsewhere, road, 40);
}

TEST(Readers, OfACopyDoNotSeeWhatBecomesOfTheOriginal) {
  Road road(7, 40, kTypical);
  InvariantEstimator estimator = driven(road, 40);
  const InvariantEstimator copy = estimator;
  const auto then = copy.exactMap()().landmarks;
  for (int i = 0; i < 30; ++i) road.feed(estimator);
  const auto now = copy.exactMap()().landmarks;
  ASSERT_EQ(now.size(), then.size());
  for (std::size_t i = 0; i < now.size(); ++i) EXPECT_EQ(now[i].covariance, then[i].covariance);
}

} // namespace
} // namespace vi_ekf_slam

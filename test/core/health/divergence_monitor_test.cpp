#include "vi_ekf_slam/core/health/divergence_monitor.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <optional>

#include "vi_ekf_slam/core/health/blindness.hpp"

namespace vi_ekf_slam {
namespace {

/// 10 Hz; 20 matched features, all used, innovations as expected, 1 m driven.
DivergenceMonitor::Frame goodFrame(int number) {
  return {fromSeconds(1000.0 + 0.1 * number), 1.0, 0.1, 20, 20, false, 60.0, 60};
}

/// The first judgement that is one, on frames that `change` makes of good ones, and its number.
template <typename Change>
std::optional<std::pair<int, Divergence>> firstIn(DivergenceMonitor& monitor, int frames, Change change) {
  for (int i = 0; i < frames; ++i) {
    DivergenceMonitor::Frame frame = goodFrame(i);
    change(i, frame);
    const Divergence divergence = monitor.add(frame);
    if (divergence != Divergence::kNone) return std::make_pair(i, divergence);
  }
  return std::nullopt;
}

TEST(DivergenceMonitor, BelievesGoodFrames) {
  DivergenceMonitor monitor({});
  EXPECT_FALSE(firstIn(monitor, 1000, [](int, auto&) {}));
}

TEST(DivergenceMonitor, IsNotMovedByEveryThirdFrame) {
  DivergenceMonitor monitor({});
  EXPECT_FALSE(firstIn(monitor, 1000, [](int i, auto& frame) { frame.rejected = i % 3 == 0; }));
}

TEST(DivergenceMonitor, FindsThatMostFramesAreRejected) {
  DivergenceMonitor monitor({});
  const auto found = firstIn(monitor, 100, [](int i, auto& frame) { frame.rejected = i >= 50; });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->second, Divergence::kRejections);
  EXPECT_GT(found->first, 60);
  EXPECT_LT(found->first, 50 + 20); // the window's length
}

/// s until the first judgement, of frames at `rate` Hz that are all as `frame` is from `since` s on.
double timeToJudgement(double rate, double since, Divergence expected,
                       const std::function<void(DivergenceMonitor::Frame&)>& change) {
  DivergenceMonitor monitor({});
  for (int i = 0; i < static_cast<int>(20.0 * rate); ++i) {
    DivergenceMonitor::Frame frame = goodFrame(0);
    frame.stamp = fromSeconds(1000.0 + i / rate);
    if (i / rate >= since) change(frame);
    const Divergence divergence = monitor.add(frame);
    if (divergence == Divergence::kNone) continue;
    EXPECT_EQ(divergence, expected) << rate;
    return i / rate - since;
  }
  return 20.0;
}

TEST(DivergenceMonitor, JudgesBySecondsAtAnyRateOfTheFrames) {
  for (const double rate : {1.0, 2.0, 5.0, 10.0, 30.0, 100.0}) {
    const auto reject = [](DivergenceMonitor::Frame& frame) { frame.rejected = true; };
    EXPECT_NEAR(timeToJudgement(rate, 5.0, Divergence::kRejections, reject), 1.6, 1.0 / rate) << rate;
    EXPECT_NEAR(timeToJudgement(rate, 0.0, Divergence::kRejections, reject), 1.5, 1.5 / rate) << rate;
    const auto contradict = [](DivergenceMonitor::Frame& frame) { frame.nis = 10.0 * 60.0; };
    EXPECT_LT(timeToJudgement(rate, 5.0, Divergence::kInnovations, contradict), 1.6) << rate;
    EXPECT_EQ(timeToJudgement(rate, 5.0, Divergence::kNone, [](auto&) {}), 20.0) << rate;
  }
}

// Two bad frames with a long silence between them are no two seconds of bad frames.
TEST(DivergenceMonitor, IsNotMovedByFewFramesAmongSilence) {
  DivergenceMonitor monitor({});
  for (const double time : {0.0, 1.0, 1.1, 1.9, 2.0}) {
    DivergenceMonitor::Frame frame = goodFrame(0);
    frame.stamp = fromSeconds(1000.0 + 3.0 * time);
    frame.rejected = true;
    EXPECT_EQ(monitor.add(frame), Divergence::kNone) << time;
  }
}

TEST(DivergenceMonitor, TakesAFrameOfWhichLittleIsUsedForRejected) {
  DivergenceMonitor monitor({});
  const auto found = firstIn(monitor, 100, [](int, auto& frame) { frame.used = 3; });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->second, Divergence::kRejections);
}

TEST(DivergenceMonitor, FindsThatInnovationsAreTooLarge) {
  DivergenceMonitor monitor({});
  const auto found = firstIn(monitor, 100, [](int, auto& frame) { frame.nis = 4.1 * 60.0; });
  ASSERT_TRUE(found);
  EXPECT_EQ(found->second, Divergence::kInnovations);
  monitor.restart();
  EXPECT_FALSE(firstIn(monitor, 100, [](int, auto& frame) { frame.nis = 3.9 * 60.0; }));
}

TEST(DivergenceMonitor, HearsNothingFromFewFeatures) {
  DivergenceMonitor monitor({});
  EXPECT_FALSE(firstIn(monitor, 100, [](int, auto& frame) {
    frame.matched = frame.used = 9;
    frame.rejected = true;
  }));
}

TEST(DivergenceMonitor, CanBeTurnedOff) {
  DivergenceMonitor monitor({0.0, 4.0, 0.8});
  EXPECT_FALSE(firstIn(monitor, 100, [](int, auto& frame) { frame.rejected = true; }));
}

TEST(DivergenceMonitor, KnowsTheWayDrivenInItsWindow) {
  DivergenceMonitor monitor({});
  firstIn(monitor, 100, [](int, auto&) {});
  EXPECT_NEAR(monitor.distance(), 21.0, 1.0); // 2 s of 1 m each 0.1 s
  EXPECT_NEAR(monitor.angle(), 2.1, 0.1);
  monitor.restart();
  EXPECT_EQ(monitor.distance(), 0.0);
}

Stamp at(double s) { return fromSeconds(1000.0 + s); }

TEST(Blindness, CountsPeriodsLongerThanItsPatience) {
  Blindness blindness;
  for (int i = 0; i <= 50; ++i) { // seen until 1 s and from 4 s on
    blindness.advanceTo(at(0.1 * i));
    EXPECT_EQ(blindness.isBlind(), i > 20 && i <= 40) << i;
    if (i <= 10 || i >= 40) blindness.noteUse();
  }
  EXPECT_EQ(blindness.periods(), 1U);
  EXPECT_NEAR(blindness.total(), 3.0, 1e-6);
  EXPECT_NEAR(blindness.current(), 0.0, 1e-6);
}

TEST(Blindness, KeepsItsTotalWhenTheClockStartsAnew) {
  Blindness blindness;
  blindness.advanceTo(at(100.0));
  blindness.advanceTo(at(105.0));
  EXPECT_NEAR(blindness.total(), 5.0, 1e-6);
  blindness.restart();
  EXPECT_FALSE(blindness.isBlind());
  blindness.advanceTo(at(0.0));
  EXPECT_EQ(blindness.current(), 0.0);
  EXPECT_NEAR(blindness.total(), 5.0, 1e-6);
  EXPECT_EQ(blindness.periods(), 1U);
}

} // namespace
} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/sensors/measurement_buffer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "../numeric.hpp"

namespace vi_ekf_slam {
namespace {

using test::Random;
using Verdict = MeasurementBuffer::Verdict;
using Key = std::pair<Stamp, Stream>;

constexpr Stamp kMs = 1000000;

Measurement make(Stream stream, Stamp stamp) {
  if (stream == Stream::kImu) return ImuSample{stamp, Eigen::Vector3d::Zero(), {}};
  if (stream == Stream::kVelocity) return VelocitySample{stamp, Eigen::Vector3d::Zero(), {}};
  return StereoFrame{stamp, {}};
}

Key keyOf(const Measurement& m) { return {stampOf(m), streamOf(m)}; }

MeasurementBuffer::Options options() {
  MeasurementBuffer::Options o;
  o.max_delay_s = 0.2;
  o.max_jump_s = 1.0;
  o.max_size = 100000;
  return o;
}

void popInto(MeasurementBuffer& buffer, std::vector<Key>& out) {
  while (const auto m = buffer.pop()) out.push_back(keyOf(*m));
}

void popAllInto(MeasurementBuffer& buffer, std::vector<Key>& out) {
  while (const auto m = buffer.popRegardless()) out.push_back(keyOf(*m));
}

struct Arrival {
  Stamp at;
  Key key;
};

/// Three streams over 6 s, each with its own rate and a random latency of at most `max_latency`; a stream
/// keeps its own order, as a connection does, and begins at any time of its first period.
std::vector<Arrival> randomArrivals(Random& random, Stamp max_latency, Stamp stereo_period) {
  std::vector<Arrival> all;
  const std::vector<std::pair<Stream, Stamp>> periods{
      {Stream::kImu, 10 * kMs}, {Stream::kVelocity, 25 * kMs}, {Stream::kStereo, stereo_period}};
  for (const auto& [stream, period] : periods) {
    Stamp last = 0;
    const auto phase = static_cast<Stamp>(random.uniform(0.0, static_cast<double>(period)));
    for (Stamp stamp = 1000 * kMs + phase; stamp < 7000 * kMs; stamp += period) {
      const auto latency = static_cast<Stamp>(random.uniform(0.0, static_cast<double>(max_latency)));
      last = std::max(last + 1, stamp + latency);
      all.push_back({last, {stamp, stream}});
    }
  }
  std::stable_sort(all.begin(), all.end(), [](const Arrival& a, const Arrival& b) { return a.at < b.at; });
  return all;
}

TEST(MeasurementBuffer, OutputDependsOnStampsAloneWhateverTheOrderOfArrival) {
  Random random(1);
  for (int trial = 0; trial < 100; ++trial) {
    // A latency up to max_delay with periods from well below to the longest that is waited for.
    const Stamp period = std::vector<Stamp>{50, 100, 200, 500, 1000}[static_cast<std::size_t>(trial % 5)];
    const auto arrivals = randomArrivals(random, 200 * kMs - 1000, period * kMs);
    MeasurementBuffer buffer(options());
    std::vector<Key> expected, released;
    for (const auto& arrival : arrivals) {
      expected.push_back(arrival.key);
      ASSERT_EQ(buffer.add(make(arrival.key.second, arrival.key.first)), Verdict::kAccepted)
          << "trial " << trial;
      popInto(buffer, released);
    }
    EXPECT_GT(released.size(), expected.size() * 7 / 10);
    popAllInto(buffer, released);
    std::sort(expected.begin(), expected.end());
    ASSERT_EQ(released, expected) << "trial " << trial;
  }
}

TEST(MeasurementBuffer, EqualStampsComeOutInTheOrderOfStreams) {
  std::vector<Stream> streams{Stream::kImu, Stream::kVelocity, Stream::kStereo};
  do {
    MeasurementBuffer buffer(options());
    for (const Stream stream : streams) ASSERT_EQ(buffer.add(make(stream, 5 * kMs)), Verdict::kAccepted);
    std::vector<Key> released;
    popInto(buffer, released);
    const std::vector<Key> expected{
        {5 * kMs, Stream::kImu}, {5 * kMs, Stream::kVelocity}, {5 * kMs, Stream::kStereo}};
    EXPECT_EQ(released, expected);
  } while (std::next_permutation(streams.begin(), streams.end()));
}

TEST(MeasurementBuffer, NothingIsDueBeforeEveryLiveStreamHasDeliveredUpToIt) {
  MeasurementBuffer buffer(options());
  buffer.add(make(Stream::kImu, 10 * kMs));
  buffer.add(make(Stream::kVelocity, 10 * kMs));
  EXPECT_FALSE(buffer.pop()) << "stereo may still bring an older one";
  buffer.add(make(Stream::kStereo, 9 * kMs));
  std::vector<Key> released;
  popInto(buffer, released);
  EXPECT_EQ(released, (std::vector<Key>{{9 * kMs, Stream::kStereo}}));
  buffer.add(make(Stream::kStereo, 30 * kMs));
  popInto(buffer, released);
  EXPECT_EQ(released,
            (std::vector<Key>{
                {9 * kMs, Stream::kStereo}, {10 * kMs, Stream::kImu}, {10 * kMs, Stream::kVelocity}}));
}

TEST(MeasurementBuffer, ASlowStreamLosesNothing) {
  // Of frames that come 20 ms after their stamps every 200 ms, the last one is up to 220 ms old.
  MeasurementBuffer buffer(options());
  std::vector<Key> released;
  for (Stamp t = 0; t <= 5000 * kMs; t += 10 * kMs) {
    if (t % (200 * kMs) == 20 * kMs) {
      EXPECT_EQ(buffer.add(make(Stream::kStereo, t - 20 * kMs)), Verdict::kAccepted) << t;
    }
    buffer.add(make(Stream::kImu, t));
    buffer.add(make(Stream::kVelocity, t));
    popInto(buffer, released);
  }
  EXPECT_TRUE(std::is_sorted(released.begin(), released.end()));
}

TEST(MeasurementBuffer, AStreamThatLosesHalfOfItsSamplesAtRandomHasOneInTwentyLateAtMost) {
  MeasurementBuffer buffer(options());
  Random random(3);
  std::vector<Key> released;
  int sent = 0, late = 0;
  for (Stamp t = 0; t <= 200000 * kMs; t += 10 * kMs) { // of frames 20 ms after their stamps, at 10 Hz
    if (t % (100 * kMs) == 20 * kMs && random.uniform(0.0, 1.0) < 0.5) {
      ++sent;
      late += buffer.add(make(Stream::kStereo, t - 20 * kMs)) == Verdict::kLate ? 1 : 0;
    }
    buffer.add(make(Stream::kImu, t));
    popInto(buffer, released);
  }
  EXPECT_GT(sent, 900);
  EXPECT_LE(late, sent / 20);
}

TEST(MeasurementBuffer, AStreamThatStopsDelaysTheOthersByAtMostMaxDelayPlusItsPeriodAndOnlyOnce) {
  MeasurementBuffer buffer(options());
  std::vector<Key> released;
  Stamp longest_held = 0;
  for (Stamp t = 0; t <= 2000 * kMs; t += 10 * kMs) {
    if (t % (100 * kMs) == 0 && t <= 1000 * kMs) buffer.add(make(Stream::kStereo, t)); // then it stops
    buffer.add(make(Stream::kImu, t));
    buffer.add(make(Stream::kVelocity, t));
    popInto(buffer, released);
    const Stamp held = buffer.empty() ? 0 : t - buffer.oldest();
    longest_held = std::max(longest_held, held);
    EXPECT_LE(held, 300 * kMs) << t;
    if (t > 1300 * kMs) {
      EXPECT_TRUE(buffer.empty()) << "still waiting for the dead stream at " << t;
    }
  }
  EXPECT_GT(longest_held, 250 * kMs) << "the test never made anybody wait";
}

TEST(MeasurementBuffer, AGapOfAStreamIsNotTakenForItsPeriodBeyondTheLongestOne) {
  MeasurementBuffer buffer(options());
  std::vector<Key> released;
  for (Stamp t = 0; t <= 60000 * kMs; t += 10 * kMs) {
    if (t == 0 || t == 30000 * kMs) buffer.add(make(Stream::kStereo, t)); // 30 s apart, then it stops
    buffer.add(make(Stream::kImu, t));
    buffer.add(make(Stream::kVelocity, t));
    popInto(buffer, released);
    if (t > 31200 * kMs) {
      EXPECT_TRUE(buffer.empty()) << "still waiting for the dead stream at " << t;
    }
  }
}

TEST(MeasurementBuffer, AStreamThatNeverSpeaksDelaysTheStartByAtMostMaxDelayPlusTheLongestPeriod) {
  MeasurementBuffer buffer(options());
  std::vector<Key> released;
  for (Stamp t = 0; t <= 2000 * kMs; t += 10 * kMs) {
    buffer.add(make(Stream::kImu, t));
    popInto(buffer, released);
    if (t < 1200 * kMs) {
      EXPECT_TRUE(released.empty()) << t;
    } else {
      EXPECT_TRUE(buffer.empty()) << t;
    }
  }
}

TEST(MeasurementBuffer, AStreamThatReturnsIsWaitedForAgain) {
  MeasurementBuffer buffer(options());
  std::vector<Key> released;
  for (Stamp t = 0; t <= 1500 * kMs; t += 10 * kMs) buffer.add(make(Stream::kImu, t));
  popInto(buffer, released);
  ASSERT_TRUE(buffer.empty());
  buffer.add(make(Stream::kStereo, 1505 * kMs));
  buffer.add(make(Stream::kImu, 1510 * kMs));
  popInto(buffer, released);
  EXPECT_EQ(released.back(), Key(1505 * kMs, Stream::kStereo));
  EXPECT_EQ(buffer.size(), 1U);
}

TEST(MeasurementBuffer, AStreamThatReturnsWithALatencyLosesOneSampleAndNoMore) {
  MeasurementBuffer buffer(options());
  std::vector<Key> released;
  std::vector<Stamp> late;
  for (Stamp t = 0; t <= 10000 * kMs; t += 10 * kMs) {
    const bool silent = t > 2000 * kMs && t < 6000 * kMs;
    if (t % (100 * kMs) == 50 * kMs && !silent &&
        buffer.add(make(Stream::kStereo, t - 50 * kMs)) == Verdict::kLate) {
      late.push_back(t - 50 * kMs);
    }
    buffer.add(make(Stream::kImu, t));
    buffer.add(make(Stream::kVelocity, t));
    popInto(buffer, released);
  }
  EXPECT_EQ(late, (std::vector<Stamp>{6000 * kMs}));
}

TEST(MeasurementBuffer, WhatAStreamSendsAfterANewerSampleOfItsOwnMayBeLate) {
  MeasurementBuffer buffer(options());
  buffer.add(make(Stream::kVelocity, 20 * kMs));
  buffer.add(make(Stream::kStereo, 20 * kMs));
  buffer.add(make(Stream::kImu, 12 * kMs));
  std::vector<Key> released;
  popInto(buffer, released);
  ASSERT_EQ(released, (std::vector<Key>{{12 * kMs, Stream::kImu}}));
  EXPECT_EQ(buffer.add(make(Stream::kImu, 11 * kMs)), Verdict::kLate);
}

TEST(MeasurementBuffer, WhatIsOlderThanTheLastReleasedIsLate) {
  MeasurementBuffer buffer(options());
  for (const Stream stream : {Stream::kImu, Stream::kVelocity, Stream::kStereo})
    buffer.add(make(stream, 50 * kMs));
  ASSERT_TRUE(buffer.pop());
  EXPECT_EQ(buffer.add(make(Stream::kImu, 49 * kMs)), Verdict::kLate);
  EXPECT_EQ(buffer.add(make(Stream::kVelocity, 49 * kMs)), Verdict::kLate);
  EXPECT_EQ(buffer.size(), 2U);
}

TEST(MeasurementBuffer, ASecondMeasurementOfAStreamAtOneStampIsADuplicate) {
  MeasurementBuffer buffer(options());
  EXPECT_EQ(buffer.add(make(Stream::kImu, 50 * kMs)), Verdict::kAccepted);
  EXPECT_EQ(buffer.add(make(Stream::kImu, 50 * kMs)), Verdict::kDuplicate) << "still held";
  EXPECT_EQ(buffer.add(make(Stream::kVelocity, 50 * kMs)), Verdict::kAccepted) << "another stream";
  ASSERT_TRUE(buffer.popRegardless());
  EXPECT_EQ(buffer.add(make(Stream::kImu, 50 * kMs)), Verdict::kDuplicate) << "already handed out";
  EXPECT_EQ(buffer.add(make(Stream::kStereo, 50 * kMs)), Verdict::kAccepted)
      << "equal to the last, not older";
}

TEST(MeasurementBuffer, AnOlderStampByMoreThanMaxJumpIsAJumpBackAndStoresNothing) {
  MeasurementBuffer buffer(options());
  buffer.add(make(Stream::kImu, 5000 * kMs));
  EXPECT_EQ(buffer.add(make(Stream::kImu, 4000 * kMs - 1)), Verdict::kJumpBack);
  EXPECT_EQ(buffer.size(), 1U);
  EXPECT_EQ(buffer.newest(), 5000 * kMs);
  EXPECT_EQ(buffer.oldest(), 5000 * kMs);
  EXPECT_EQ(buffer.add(make(Stream::kImu, 4000 * kMs)), Verdict::kAccepted) << "exactly max_jump_s is none";
}

TEST(MeasurementBuffer, ABoundedJumpBackOfDataAlreadyHandedOutIsLate) {
  MeasurementBuffer buffer(options());
  buffer.add(make(Stream::kImu, 5000 * kMs));
  ASSERT_TRUE(buffer.popRegardless());
  EXPECT_EQ(buffer.add(make(Stream::kImu, 4000 * kMs)), Verdict::kLate);
  EXPECT_EQ(buffer.add(make(Stream::kImu, 4000 * kMs - 1)), Verdict::kJumpBack);
}

TEST(MeasurementBuffer, NeverReleasesOutOfOrderWhateverArrives) {
  Random random(2);
  for (int trial = 0; trial < 50; ++trial) {
    auto o = options();
    o.max_size = trial % 2 == 0 ? 20 : 100000;
    MeasurementBuffer buffer(o);
    std::vector<Key> released;
    std::size_t accepted = 0;
    for (int i = 0; i < 1000; ++i) {
      const double jitter = random.uniform(-0.9, 0.0);
      const auto stamp = static_cast<Stamp>((2000.0 + 5.0 * i + 1000.0 * jitter)) * kMs;
      const auto stream = static_cast<Stream>(static_cast<std::size_t>(random.uniform(0.0, 2.999)));
      accepted += buffer.add(make(stream, stamp)) == Verdict::kAccepted ? 1 : 0;
      popInto(buffer, released);
    }
    popAllInto(buffer, released);
    EXPECT_EQ(released.size(), accepted) << "accepted means: comes out once";
    EXPECT_EQ(std::set<Key>(released.begin(), released.end()).size(), released.size()) << "twice the same";
    EXPECT_TRUE(std::is_sorted(released.begin(), released.end(),
                               [](const Key& a, const Key& b) { return a.first < b.first; }));
    EXPECT_LT(accepted, 1000U) << "the jitter never made anything late";
  }
}

TEST(MeasurementBuffer, HoldsAtMostMaxSizeAndReleasesTheOldestBeyond) {
  auto o = options();
  o.max_size = 10;
  MeasurementBuffer buffer(o);
  std::vector<Key> released;
  for (Stamp t = 1; t <= 100; ++t) {
    buffer.add(make(Stream::kImu, t * kMs)); // 100 ms in all: nothing would be due otherwise
    popInto(buffer, released);
    EXPECT_LE(buffer.size(), 10U);
  }
  ASSERT_EQ(released.size(), 90U);
  EXPECT_EQ(released.front(), Key(1 * kMs, Stream::kImu));
  EXPECT_EQ(released.back(), Key(90 * kMs, Stream::kImu));
}

TEST(MeasurementBuffer, ClearForgetsEverything) {
  MeasurementBuffer buffer(options());
  for (const Stream stream : {Stream::kImu, Stream::kVelocity, Stream::kStereo}) {
    buffer.add(make(stream, 9000 * kMs));
    buffer.add(make(stream, 9001 * kMs));
  }
  ASSERT_TRUE(buffer.pop());
  buffer.clear();
  EXPECT_TRUE(buffer.empty());
  EXPECT_FALSE(buffer.newest());
  EXPECT_FALSE(buffer.pop());
  EXPECT_FALSE(buffer.popRegardless());
  EXPECT_EQ(buffer.add(make(Stream::kImu, 10 * kMs)), Verdict::kAccepted) << "neither late nor a jump back";
  EXPECT_EQ(buffer.newest(), 10 * kMs);
  EXPECT_FALSE(buffer.pop()) << "the other streams have not spoken since the clear";
}

TEST(MeasurementBuffer, AfterAClearTheOtherStreamsAreWaitedForAtLaterStampsToo) {
  MeasurementBuffer buffer(options());
  buffer.add(make(Stream::kImu, 10 * kMs));
  buffer.clear();
  buffer.add(make(Stream::kImu, 9000 * kMs));
  EXPECT_FALSE(buffer.pop());
}

TEST(MeasurementBuffer, AnEmptyBufferHasNothingToPop) {
  MeasurementBuffer buffer(options());
  EXPECT_FALSE(buffer.pop());
  EXPECT_FALSE(buffer.popRegardless());
  EXPECT_EQ(buffer.size(), 0U);
  EXPECT_FALSE(buffer.newest());
}

} // namespace
} // namespace vi_ekf_slam

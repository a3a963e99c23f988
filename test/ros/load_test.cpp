#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "vi_ekf_slam/ros/input/feature_screen.hpp"
#include "vi_ekf_slam/ros/node/latency_meter.hpp"
#include "vi_ekf_slam/ros/node/work_queue.hpp"
#include "vi_ekf_slam/ros/output/pacer.hpp"

namespace vi_ekf_slam {
namespace {

using std::chrono::milliseconds;

/// Runs all that the queue still gives, in its order.
std::string takeAll(WorkQueue& queue, std::string& done) {
  while (auto item = queue.pop(0.0)) item->work();
  return done;
}

class Queue : public testing::Test {
 protected:
  void push(WorkQueue& queue, char name, std::optional<Stream> stream) {
    EXPECT_TRUE(queue.push([this, name] { done_ += name; }, stream));
  }
  /// Whose clock stands still until it is moved.
  WorkQueue::Options options(double max_latency_s, std::size_t max_features = 400) const {
    return {max_latency_s, 100, max_features, [this] { return now_; }};
  }
  std::string done_;
  WorkQueue::Clock::time_point now_;
};

TEST_F(Queue, keeps_the_order_of_arrival) {
  WorkQueue queue({0.3, 100});
  push(queue, 'g', Stream::kImu);
  push(queue, 'f', Stream::kStereo);
  push(queue, 'c', std::nullopt);
  push(queue, 'v', Stream::kVelocity);
  EXPECT_EQ("gfcv", takeAll(queue, done_));
}

TEST_F(Queue, sheds_old_frames_the_oldest_first_and_never_the_newest_nor_anything_else) {
  WorkQueue queue(options(0.05));
  push(queue, '0', Stream::kStereo);
  for (const char frame : {'1', '2', '3'}) {
    push(queue, 'g', Stream::kImu);
    push(queue, 'v', Stream::kVelocity);
    push(queue, frame, Stream::kStereo);
  }
  now_ += milliseconds(100);
  EXPECT_EQ("0gvgvgv3", takeAll(queue, done_));
  EXPECT_EQ(2U, queue.counts().frames_shed);
}

TEST_F(Queue, gives_out_a_frame_now_and_then_however_old_they_are) {
  WorkQueue queue(options(0.02));
  for (const char frame : {'1', '2', '3', '4'}) push(queue, frame, Stream::kStereo);
  now_ += milliseconds(40);
  queue.pop(0.0)->work();
  now_ += milliseconds(40);
  queue.pop(0.0)->work();
  EXPECT_EQ("12", done_);
  EXPECT_EQ(0U, queue.counts().frames_shed);
  EXPECT_EQ("124", takeAll(queue, done_));
}

TEST_F(Queue, sheds_nothing_that_is_young_or_when_told_not_to) {
  WorkQueue young(options(10.0)), patient(options(0.0));
  for (WorkQueue* queue : {&young, &patient}) {
    push(*queue, 'a', Stream::kStereo);
    push(*queue, 'b', Stream::kStereo);
    now_ += std::chrono::seconds(9);
    takeAll(*queue, done_);
    EXPECT_EQ(0U, queue->counts().frames_shed);
  }
  EXPECT_EQ("abab", done_);
}

TEST_F(Queue, wants_fewer_features_of_a_frame_once_one_has_waited) {
  WorkQueue queue(options(0.05, 200));
  EXPECT_EQ(200U, queue.featureLimit());
  push(queue, 'g', Stream::kImu);
  push(queue, 'f', Stream::kStereo);
  now_ += milliseconds(100);
  ASSERT_TRUE(queue.pop(0.0));
  EXPECT_EQ(200U, queue.featureLimit());
  ASSERT_TRUE(queue.pop(0.0));
  EXPECT_EQ(100U, queue.featureLimit());
}

TEST_F(Queue, is_bounded_frames_go_first_and_losses_are_counted) {
  WorkQueue queue({0.0, 3});
  push(queue, 'g', Stream::kImu);
  push(queue, 'f', Stream::kStereo);
  push(queue, 'c', std::nullopt);
  push(queue, 'h', Stream::kImu);      // f goes
  push(queue, 'v', Stream::kVelocity); // g goes
  EXPECT_EQ("chv", takeAll(queue, done_));
  const auto overflow = queue.counts().overflow;
  EXPECT_EQ(1U, overflow[static_cast<std::size_t>(Stream::kImu)]);
  EXPECT_EQ(1U, overflow[static_cast<std::size_t>(Stream::kStereo)]);
}

TEST_F(Queue, closed_takes_nothing_more_but_gives_what_it_holds) {
  WorkQueue queue({0.0, 10});
  push(queue, 'a', Stream::kImu);
  queue.close();
  EXPECT_FALSE(queue.push([] {}, Stream::kImu));
  EXPECT_EQ("a", takeAll(queue, done_));
  EXPECT_EQ(0U, queue.clear());
}

TEST(Load, fewer_features_while_frames_wait_and_more_again_when_they_do_not) {
  LoadControl load(400, 0.4);
  EXPECT_EQ(400U, load.limit());
  for (int i = 0; i < 3; ++i) load.noteFrame(0.2);
  EXPECT_EQ(204U, load.limit());
  for (int i = 0; i < 100; ++i) load.noteFrame(1.0);
  EXPECT_EQ(LoadControl::kMinFeatures, load.limit());
  for (int i = 0; i < 1000; ++i) load.noteFrame(0.001);
  EXPECT_EQ(400U, load.limit());
  LoadControl few(10, 0.4);
  few.noteFrame(1.0);
  EXPECT_EQ(10U, few.limit());
  LoadControl patient(400, 0.0);
  patient.noteFrame(100.0);
  EXPECT_EQ(400U, patient.limit());
}

TEST(Latency, is_from_arrival_to_result_of_the_same_stamp) {
  LatencyMeter meter;
  const WorkQueue::Clock::time_point now;
  meter.noteArrival(Stream::kImu, 1, now - milliseconds(500));
  meter.noteArrival(Stream::kImu, 2, now - milliseconds(100));
  meter.noteArrival(Stream::kStereo, 2, now - milliseconds(300));
  meter.noteResult(Stream::kStereo, 2, now);
  meter.noteResult(Stream::kImu, 2, now);
  meter.noteResult(Stream::kImu, 1, now); // overtaken
  meter.noteResult(Stream::kImu, 7, now); // never arrived
  const auto summary = meter.take();
  EXPECT_EQ(2U, summary.results);
  EXPECT_DOUBLE_EQ(0.3, summary.max_s);
  EXPECT_EQ(0U, meter.take().results);
}

TEST(Pace, holds_period_and_bandwidth) {
  Pacer pacer(0.5, 1e6);
  constexpr Stamp kSecond = 1000000000;
  EXPECT_TRUE(pacer.isDue(0));
  pacer.noteSent(0, 100);
  EXPECT_FALSE(pacer.isDue(kSecond / 4));
  EXPECT_TRUE(pacer.isDue(kSecond / 2));
  pacer.noteSent(kSecond, 3000000); // 3 s at this bandwidth
  EXPECT_FALSE(pacer.isDue(kSecond * 39 / 10));
  EXPECT_TRUE(pacer.isDue(4 * kSecond));
  EXPECT_EQ(3.0, pacer.wait());
  pacer.setRate(5.0, 1e6);
  EXPECT_EQ(5.0, pacer.wait());
  pacer.restart();
  EXPECT_TRUE(pacer.isDue(0));
  EXPECT_EQ(0.0, pacer.wait());
}

StereoFrame frameOf(const std::vector<StereoPixels>& pixels) {
  StereoFrame frame;
  for (const auto& z : pixels) frame.features.push_back({frame.features.size(), z});
  return frame;
}

TEST(Screen, removes_what_is_unusable_one_by_one_and_counts_the_reasons) {
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  StereoFrame frame = frameOf({{100, 50, 90, 50},
                               {nan, 50, 90, 50},
                               {100, 50, 90, -inf},
                               {700, 50, 690, 50},
                               {100, 50, -5, 50},
                               {100, 480.5, 90, 480.5},
                               {100, -0.5, 90, -0.5},
                               {100, 1e300, 90, 50},
                               {639, 50, -1.0, 50},
                               {100, 50, 110, 50}});
  const ScreenCounts counts = screenFeatures(frame, ImageSize{640, 480}, 1000);
  EXPECT_EQ(2U, counts.not_finite);
  EXPECT_EQ(3U, counts.outside);
  EXPECT_EQ(2U, counts.absurd);
  EXPECT_EQ(1U, counts.no_disparity);
  std::vector<FeatureId> ids;
  for (const auto& f : frame.features) ids.push_back(f.id);
  EXPECT_EQ((std::vector<FeatureId>{0, 6, 9}), ids);
}

TEST(Screen, removes_a_noise_and_a_walk_that_are_none) {
  const double nan = std::nan("");
  StereoFrame frame = frameOf(std::vector<StereoPixels>(5, {100, 50, 90, 50}));
  frame.features[0].sigma = frame.features[1].walk = nan;
  frame.features[2].sigma = frame.features[3].walk = -0.1;
  const ScreenCounts counts = screenFeatures(frame, ImageSize{640, 480}, 1000);
  EXPECT_EQ(2U, counts.not_finite);
  EXPECT_EQ(2U, counts.absurd);
  ASSERT_EQ(1U, frame.features.size());
  EXPECT_EQ(4U, frame.features[0].id);
}

TEST(Screen, knows_no_outside_without_the_size_of_the_image) {
  StereoFrame frame = frameOf({{7000, 50, 690, 50}, {2e6, 50, 90, 50}});
  const ScreenCounts counts = screenFeatures(frame, std::nullopt, 1000);
  EXPECT_EQ(0U, counts.outside);
  EXPECT_EQ(1U, counts.absurd);
  EXPECT_EQ(1U, frame.features.size());
}

TEST(Screen, of_too_many_takes_the_same_tracks_from_frame_to_frame) {
  StereoFrame first = frameOf(std::vector<StereoPixels>(50000, {100, 50, 90, 50})), second = first;
  second.features.erase(second.features.begin(), second.features.begin() + 100);
  EXPECT_EQ(49600U, screenFeatures(first, ImageSize{640, 480}, 400).surplus);
  screenFeatures(second, ImageSize{640, 480}, 400);
  ASSERT_EQ(400U, first.features.size());
  ASSERT_EQ(400U, second.features.size());
  std::set<FeatureId> kept;
  for (const auto& f : first.features) kept.insert(f.id);
  EXPECT_GT(*kept.rbegin(), 40000U) << "spread over all of them";
  std::size_t again = 0;
  for (const auto& f : second.features) again += kept.count(f.id);
  EXPECT_GT(again, 390U);
}

} // namespace
} // namespace vi_ekf_slam

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#include "../../sanitized.hpp"
#include "road.hpp"

#if defined(__GLIBC__) && !VI_EKF_SLAM_SANITIZED
#define VI_EKF_SLAM_COUNTS_ALLOCATIONS 1

namespace {

thread_local std::size_t g_allocations = 0;

} // namespace

// In the place of the C library's, for this program: by them everybody asks for memory, Eigen and operator
// new as well.
extern "C" {

void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) noexcept {
  ++g_allocations;
  return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) noexcept {
  ++g_allocations;
  return __libc_calloc(count, size);
}

void* realloc(void* memory, std::size_t size) noexcept {
  ++g_allocations;
  return __libc_realloc(memory, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  ++g_allocations;
  return __libc_memalign(alignment, size);
}

int posix_memalign(void** memory, std::size_t alignment, std::size_t size) noexcept {
  ++g_allocations;
  *memory = __libc_memalign(alignment, size);
  return *memory ? 0 : ENOMEM;
}

} // extern "C"
#endif

namespace vi_ekf_slam::invariant {
namespace {

using namespace test;

#ifdef VI_EKF_SLAM_COUNTS_ALLOCATIONS

TEST(Allocations, AreCountedWhoeverAsks) {
  const std::size_t before = g_allocations;
  const Eigen::MatrixXd matrix(10, 10);
  const std::vector<int> numbers(10);
  ::operator delete (::operator new (100, std::align_val_t{64}), std::align_val_t{64});
  EXPECT_EQ(g_allocations - before, 3u);
}

/// What the frames of a drive asked for, from one of them on, by when the pool has what a frame needs.
struct Asked {
  std::size_t frames = 0, allocations = 0;
  std::size_t where_none_left = 0; ///< of the allocations, by frames in which no landmark left the view
  std::size_t used = 0, left = 0;  ///< features and landmarks
};

Asked drive(const InvariantConfig& config, std::size_t in_view, int first, int frames) {
  Road road(2, in_view, kTypical);
  InvariantEstimator estimator = makeEstimator(config);
  Asked asked;
  for (int i = 0; i < frames; ++i) {
    const GyroSample gyro = road.gyro();
    const VelocitySample velocity = road.velocity();
    const StereoFrame frame = road.frame();
    road.move();
    const std::size_t before = g_allocations;
    estimator.process(gyro);
    estimator.process(velocity);
    const FrameReport report = estimator.process(frame);
    const std::size_t made = g_allocations - before;
    if (i < first) continue;
    ++asked.frames;
    asked.allocations += made;
    if (report.removed == 0) asked.where_none_left += made;
    asked.used += report.used;
    asked.left += report.removed;
  }
  EXPECT_GT(asked.used, asked.frames * in_view * 8 / 10);
  EXPECT_GT(asked.left, asked.frames);
  return asked;
}

/// What is marginalised makes room for what comes. (With more in view, composing packs more than fits on the
/// stack.)
TEST(Allocations, AreRareWhereTheJointMapIsBounded) {
  InvariantConfig config;
  config.map.min_observations = 3;
  config.map.max_landmarks = 500;
  for (const std::size_t in_view : {20, 60}) {
    const Asked asked = drive(config, in_view, 600, 900);
    EXPECT_LE(asked.allocations, asked.frames) << in_view;
  }
}

/// By the number of points in view.
class Allocation : public ::testing::TestWithParam<std::size_t> {};

/// Landmarks that leave the view go to the map, which gets its memory in ever larger pieces.
TEST_P(Allocation, IsNotNeededByAFrameButForWhatTheMapGains) {
  InvariantConfig config;
  config.map.keep = MapKeep::kNone;
  const Asked asked = drive(config, GetParam(), 100, 600);
  EXPECT_EQ(asked.where_none_left, 0u);
  EXPECT_LE(asked.allocations, asked.left / 50);
}

INSTANTIATE_TEST_SUITE_P(InView, Allocation, ::testing::Values(20, 60, 100, 150));

#else

TEST(Allocations, AreCountedWhoeverAsks) {
  GTEST_SKIP() << "only the C library's own allocator, of glibc, can be counted";
}

#endif

} // namespace
} // namespace vi_ekf_slam::invariant

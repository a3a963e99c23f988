#include "vi_ekf_slam/core/memory_pool.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <new>
#include <thread>

#include "../sanitized.hpp"

namespace vi_ekf_slam {
namespace {

struct Piece {
  void* memory;
  std::size_t bytes;
};

Piece take(std::size_t bytes) {
  void* const memory = takePooled(bytes);
  std::memset(memory, 0xab, bytes);
  return {memory, bytes};
}

void giveBack(const Piece& piece) { giveBackPooled(piece.memory, piece.bytes); }

TEST(MemoryPool, GivesAlignedMemoryOfEverySizeThatNobodyElseHas) {
  std::vector<Piece> pieces;
  for (std::size_t bytes = 0; bytes < 3000; bytes += 7) pieces.push_back(take(bytes));
  for (const std::size_t bytes : {kLargestPooled - 1, kLargestPooled, kLargestPooled + 1, 2 * kLargestPooled})
    pieces.push_back(take(bytes));
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(pieces[i].memory) % kPoolAlignment, 0u) << pieces[i].bytes;
    std::memset(pieces[i].memory, static_cast<int>(i % 256), pieces[i].bytes);
  }
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const auto* bytes = static_cast<const unsigned char*>(pieces[i].memory);
    for (std::size_t k = 0; k < pieces[i].bytes; k += 61) ASSERT_EQ(bytes[k], i % 256) << pieces[i].bytes;
    giveBack(pieces[i]);
  }
}

TEST(MemoryPool, GivesAgainWhatWasGivenBackLast) {
  if (kSanitized) GTEST_SKIP() << "nothing is kept, for the sanitizer to see all";
  const Piece first = take(100000), second = take(100000);
  giveBack(first);
  giveBack(second);
  EXPECT_EQ(takePooled(90000), second.memory);
  EXPECT_EQ(takePooled(100000), first.memory);
  giveBack(first);
  giveBackPooled(second.memory, 90000);
  const Piece small = take(10);
  giveBack(small);
  EXPECT_EQ(takePooled(64), small.memory);
  giveBackPooled(small.memory, 64);
}

TEST(MemoryPool, TakesBackWhatAnotherThreadTook) {
  Piece piece{};
  std::thread([&piece] { piece = take(5000); }).join(); // whose pool is gone
  std::memset(piece.memory, 1, piece.bytes);
  giveBack(piece);
  std::thread([] {
    const Piece own = take(5000);
    giveBack(own);
    const Piece again = take(5000);
    std::thread([again] { giveBack(again); }).join();
  }).join();
}

/// Gives back after the pool of its thread has ended.
TEST(MemoryPool, TakesBackWhatIsGivenAsAThreadEnds) {
  std::thread([] {
    struct Late {
      Piece piece = take(3000);
      ~Late() { giveBack(piece); }
    };
    thread_local Late late; // before the pool keeps anything, so it goes after it
    EXPECT_NE(late.piece.memory, nullptr);
    giveBack(take(3000));
  }).join();
}

TEST(MemoryPool, KeepsNoMoreOfOthersThanItHasNeededItself) {
  if (kSanitized) GTEST_SKIP() << "nothing is kept, for the sanitizer to see all";
  std::vector<Piece> of_another;
  std::thread([&of_another] {
    for (int i = 0; i < 10; ++i) of_another.push_back(take(6000));
  }).join();
  std::thread([&of_another] {
    const std::vector<Piece> own{take(6000), take(6000)};
    for (const Piece& piece : own) giveBack(piece);
    for (const Piece& piece : of_another) giveBack(piece);
    EXPECT_EQ(takePooled(6000), own[1].memory);
    EXPECT_EQ(takePooled(6000), own[0].memory);
    for (const Piece& piece : own) giveBack(piece);
  }).join();
}

TEST(MemoryPool, KeepsNoMoreThanItMay) {
  if (kSanitized) GTEST_SKIP() << "nothing is kept, for the sanitizer to see all";
  constexpr std::size_t kFit = kMostPooled / kLargestPooled;
  std::thread([] {
    std::vector<void*> taken;
    for (std::size_t i = 0; i < kFit + 3; ++i) taken.push_back(takePooled(kLargestPooled));
    for (void* memory : taken) giveBackPooled(memory, kLargestPooled);
    // The last ones kept come first; those beyond went back to the system.
    for (std::size_t i = kFit; i-- > 0;) EXPECT_EQ(takePooled(kLargestPooled), taken[i]) << i;
    for (std::size_t i = 0; i < kFit; ++i) giveBackPooled(taken[i], kLargestPooled);
  }).join();
}

TEST(MemoryPool, RefusesWhatNoMachineHas) {
  if (kSanitized) GTEST_SKIP() << "AddressSanitizer ends the program in its place";
  EXPECT_THROW(takePooled(std::numeric_limits<std::size_t>::max()), std::bad_alloc);
  EXPECT_THROW(takePooled(std::numeric_limits<std::size_t>::max() / 2 - 10), std::bad_alloc);
  EXPECT_THROW(PoolAllocator<double>().allocate(std::numeric_limits<std::size_t>::max() / 4), std::bad_alloc);
}

TEST(MemoryPool, ServesContainers) {
  PooledVector<int> numbers;
  PooledHashMap<int, double> map;
  PooledHashSet<int> set;
  PooledMap<int, int> ordered;
  PooledDeque<int> queue;
  PooledVector<bool> flags;
  for (int i = 0; i < 1000; ++i) {
    numbers.push_back(i);
    map[i] = i;
    set.insert(i % 100);
    ordered[-i] = i;
    queue.push_back(i);
    if (i % 2 == 1) queue.pop_front();
    flags.push_back(i % 3 == 0);
  }
  const PooledVector<int> copy = numbers;
  numbers.clear();
  EXPECT_EQ(copy.size(), 1000u);
  EXPECT_EQ(copy[999], 999);
  EXPECT_EQ(map.at(500), 500.0);
  EXPECT_EQ(set.size(), 100u);
  EXPECT_EQ(ordered.begin()->second, 999);
  EXPECT_EQ(queue.front(), 500);
  EXPECT_TRUE(flags[999]);
}

} // namespace
} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/freed_memory.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstdlib>
#include <vector>

#include "../sanitized.hpp"

namespace vi_ekf_slam {
namespace {

/// Pages that the system had to hand out to this process so far.
long pageFaults() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_minflt;
}

TEST(FreedMemory, IsUsedAgain) {
#ifndef __GLIBC__
  GTEST_SKIP() << "nothing is promised without glibc";
#endif
  if (kSanitized) GTEST_SKIP() << "a sanitizer has an allocator of its own";
  constexpr std::size_t kMatrices = 8, kDoubles = 1 << 17; // 1 MiB, 256 pages each
  keepFreedMemory();
  const auto useIt = [] {
    std::vector<std::vector<double>> matrices(kMatrices, std::vector<double>(kDoubles, 1.0));
  };
  useIt();
  const long before = pageFaults();
  for (int i = 0; i < 100; ++i) useIt();
  EXPECT_LT(pageFaults() - before, 256);
}

} // namespace
} // namespace vi_ekf_slam

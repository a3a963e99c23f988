#include "vi_ekf_slam/core/freed_memory.hpp"

#include <cstdlib> // whose it is

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace vi_ekf_slam {

void keepFreedMemory() {
#ifdef __GLIBC__
  constexpr int kMiB = 1 << 20;
  mallopt(M_TRIM_THRESHOLD, 64 * kMiB);
  mallopt(M_MMAP_THRESHOLD, 32 * kMiB); // the most that glibc takes
#endif
}

} // namespace vi_ekf_slam

#pragma once

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace vi_ekf_slam {

/// For the main() of a program: what is freed stays with the process. A frame's matrices are freed and asked
/// for again ten times a second; glibc gives their pages back in between, and the kernel clears new ones: a
/// tenth of the time of a frame.
inline void keepFreedMemory() {
#if defined(__GLIBC__)
  constexpr int kLargest = 1 << 28; // bytes
  if (mallopt(M_MMAP_THRESHOLD, kLargest) == 0)
    mallopt(M_MMAP_THRESHOLD, 1 << 25); // all that older ones of glibc allow
  mallopt(M_TRIM_THRESHOLD, kLargest);
  mallopt(M_MXFAST, 0); // else small chunks wait to be merged, all of them whenever a large one is freed
#endif
}

} // namespace vi_ekf_slam

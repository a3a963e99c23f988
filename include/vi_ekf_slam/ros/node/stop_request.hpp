#pragma once

#include <atomic>

namespace vi_ekf_slam {

/// Whether the process is told to end: by a signal, in whichever thread it comes, or by another thread.
inline std::atomic<bool> g_stop{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may set it");

/// For std::signal.
inline void requestStop(int /*signal*/) { g_stop = true; }

} // namespace vi_ekf_slam

#pragma once

namespace vi_ekf_slam {

/// Has the process keep up to 64 MiB of what it freed for what it allocates next: a frame's matrices go back
/// to the system when it is done otherwise, and every page of the next frame's has to be asked for again. For
/// programs, which own their process. Does nothing where the C library is not glibc.
void keepFreedMemory();

} // namespace vi_ekf_slam

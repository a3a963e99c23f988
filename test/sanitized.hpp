#pragma once

namespace vi_ekf_slam {

/// Whether GCC's AddressSanitizer or ThreadSanitizer is built in. A frame takes twenty times as long with
/// one, so that long tests drive less far, or with one seed.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

} // namespace vi_ekf_slam

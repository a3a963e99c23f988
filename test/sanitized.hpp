#pragma once

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define VI_EKF_SLAM_SANITIZED 1
#else
#define VI_EKF_SLAM_SANITIZED 0
#endif

namespace vi_ekf_slam {

/// Whether GCC's AddressSanitizer or ThreadSanitizer is built in. A frame takes twenty times as long with
/// one, so that long tests drive less far, or with one seed.
inline constexpr bool kSanitized = VI_EKF_SLAM_SANITIZED;

} // namespace vi_ekf_slam

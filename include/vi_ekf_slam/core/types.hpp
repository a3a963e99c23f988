#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace vi_ekf_slam {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Sensor time in nanoseconds since the epoch. An integer, so that stamps compare and print exactly.
using Stamp = std::int64_t;

/// Seconds from `from` to `to`.
inline double secondsBetween(Stamp from, Stamp to) { return static_cast<double>(to - from) * 1e-9; }

inline double toSeconds(Stamp stamp) { return static_cast<double>(stamp) * 1e-9; }

/// Nearest stamp; `seconds` must be finite and below 9.2e9.
inline Stamp fromSeconds(double seconds) {
  return static_cast<Stamp>(seconds * 1e9 + (seconds < 0.0 ? -0.5 : 0.5));
}

} // namespace vi_ekf_slam

#pragma once

#include "vi_ekf_slam/core/slam/slam_system.hpp"

namespace vi_ekf_slam::fuzz {

/// Ends the program with `what` on stderr unless `law` holds; the fuzzer keeps the input that led there.
void require(bool law, const char* what);

/// What must hold of every estimate, whatever was fed in: finite, a rotation, covariances symmetric with
/// diagonals that are not negative, and counts that fit each other.
void checkOutput(const Output& output);

/// The same for the map, whose size is at most `most`.
void checkLandmarks(const Estimator& estimator, std::size_t most);

/// Has checkOutput called with everything that `system` gives out.
void watch(SlamSystem& system);

} // namespace vi_ekf_slam::fuzz

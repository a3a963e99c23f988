#pragma once

#include <cstddef>
#include <vector>

#include "vi_ekf_slam/core/invariant/state.hpp"

namespace vi_ekf_slam::invariant {

/// Two landmarks of a state that are believed to be one point: indices into State::landmarks().
struct Twin {
  std::size_t now;    ///< tracked at present
  std::size_t before; ///< seen before
};

/// What became of twins.
struct TwinFusion {
  PooledVector<bool> fused; ///< twin by twin
  double nis = 0.0;         ///< of those that were fused, jointly
  std::size_t dof = 0;
};

/// Tells the state that both landmarks of a twin are the same point, for the largest set of twins that agree
/// with each other under the state's own covariance: each twin in turn is believed, and the others are judged
/// by the chi-square of what is left (one hypothesis suffices where errors are that correlated; Neira and
/// Tardos, "Data association in stochastic mapping using the joint compatibility test", 2001). Nothing is
/// fused where fewer than `least` agree, or where the set as a whole is not plausible. `sigma` (m) is how far
/// apart the two of a twin may be. Landmarks keep their places.
TwinFusion fuseTwins(State& state, const std::vector<Twin>& twins, std::size_t least, double sigma);

} // namespace vi_ekf_slam::invariant

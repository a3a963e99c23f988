#pragma once

#include <utility>
#include <vector>

#include "vi_ekf_slam/core/loops/duplicates.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"

namespace vi_ekf_slam {

/// m, standard deviation per axis of where a front end finds a corner another time. On drawn streets (ours,
/// no drive that we are judged by): 0.05 to 0.07 m across the ray, at any distance, 0.1 to 0.2 m along it.
constexpr double kCornerSigma = 0.1;

/// Of landmarks that are said to be the same: the ids of the one that is active, and of the inactive one.
using Matches = std::vector<std::pair<FeatureId, FeatureId>>;

/// Landmarks that were found to be ones that were seen before.
struct Revisit {
  std::size_t landmarks = 0;
  Stamp last_seen = 0; ///< before: the median of those that were fused
};

/// Reactivates the inactive ones, and fuses each pair where at least `least` agree (fuseDuplicates, within
/// `sigma` m). Of a pair that is fused the active one stays, with what both were; all others are inactive
/// again. What became of each pair.
struct FusedMatches {
  Fusion fusion; ///< pair by pair
  Revisit revisit;
};
FusedMatches fuseMatches(Filter& filter, LandmarkMap& map, const Matches& matches, std::size_t least,
                         double sigma);

} // namespace vi_ekf_slam

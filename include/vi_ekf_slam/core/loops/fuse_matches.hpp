#pragma once

#include <utility>
#include <vector>

#include "vi_ekf_slam/core/map/landmark_map.hpp"

namespace vi_ekf_slam {

/// m, standard deviation per axis of where a front end finds a corner another time. On drawn streets (ours,
/// no drive that we are judged by): 0.05 to 0.07 m across the ray, at any distance, 0.1 to 0.2 m along it.
constexpr double kCornerSigma = 0.1;

/// Two active points that are said to be the same one.
struct Duplicate {
  Handle now;    ///< as it is seen now
  Handle before; ///< as it was seen before
};

/// The measurements of the largest consensus over hypotheses of one: those that agree with it under the
/// filter's covariance, each by itself. All have three rows.
std::vector<bool> largestAgreement(const Innovation& in);

/// Tells the filter that points are the same, within `sigma` m, where at least `least` of the pairs agree
/// with each other under its covariance: largestAgreement of them, and a gate on all of it. Both points of a
/// pair stay. Nothing changes where too few agree. Which pairs are fused.
std::vector<bool> fuseDuplicates(Filter& filter, const std::vector<Duplicate>& pairs, std::size_t least,
                                 double sigma);

/// Of landmarks that are said to be the same: the ids of the one that is active, and of the inactive one.
using Matches = std::vector<std::pair<FeatureId, FeatureId>>;

/// Landmarks that were found to be ones that were seen before.
struct Revisit {
  std::size_t landmarks = 0;
  Stamp last_seen = 0; ///< before: the median of those that were fused
};

/// Reactivates the inactive ones, and fuses each pair where at least `least` agree (fuseDuplicates, within
/// `sigma` m). Of a pair that is fused the active one stays, with what both were; all others are inactive
/// again.
Revisit fuseMatches(Filter& filter, LandmarkMap& map, const Matches& matches, std::size_t least,
                    double sigma);

} // namespace vi_ekf_slam

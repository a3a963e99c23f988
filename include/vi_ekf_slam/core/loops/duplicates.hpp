#pragma once

#include <algorithm>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"

namespace vi_ekf_slam {

/// Two active points that are said to be the same one.
struct Duplicate {
  Handle now;    ///< as it is seen now
  Handle before; ///< as it was seen before
};

struct Fusion {
  std::vector<bool> fused; ///< pair by pair
  auto count() const { return static_cast<std::size_t>(std::count(fused.begin(), fused.end(), true)); }
};

/// The measurements of the largest consensus over hypotheses of one: those that agree with it under the
/// filter's covariance, each by itself. All have three rows.
std::vector<bool> largestAgreement(const Innovation& in);

/// Tells the filter that points are the same, within `sigma` m, where at least `least` of the pairs agree
/// with each other under its covariance: largestAgreement of them, and a gate on all of it. Both points of a
/// pair stay. Nothing changes where too few agree.
Fusion fuseDuplicates(Filter& filter, const std::vector<Duplicate>& pairs, std::size_t least, double sigma);

} // namespace vi_ekf_slam

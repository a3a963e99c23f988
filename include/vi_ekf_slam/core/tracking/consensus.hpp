#pragma once

#include <vector>

#include "vi_ekf_slam/core/filter/innovation.hpp"

namespace vi_ekf_slam {

/// 1-point RANSAC within the filter (Civera et al., "1-Point RANSAC for extended Kalman filtering", Journal
/// of Field Robotics 27(5), 2010), over all hypotheses instead of random ones: the largest set of stereo
/// measurements on which the state agrees once it has been corrected by one of them. A measurement agrees
/// when less than `threshold` is left of its squared residual, weighted by the noise of its pixels. Only
/// `plausible` ones take part.
std::vector<bool> largestConsensus(const Innovation& in, double threshold,
                                   const std::vector<bool>& plausible);

} // namespace vi_ekf_slam

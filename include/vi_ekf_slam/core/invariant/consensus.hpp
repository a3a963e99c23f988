#pragma once

#include <Eigen/Core>

#include "vi_ekf_slam/core/invariant/stereo_update.hpp"

namespace vi_ekf_slam::invariant {

/// 1-point RANSAC inside the filter (Civera, Grasa, Davison and Montiel, "1-Point RANSAC for EKF filtering",
/// 2010), exhaustive instead of random: every observation in turn updates the state on its own, which takes
/// no more than blocks of S, and all others are judged by what is left of their innovations.
///
/// `S` and `noise` are StereoModel's. `threshold` bounds the sum of the four squared pixel residuals, px^2;
/// an observation that is not `plausible` takes no part. Returns, observation by observation, whether it
/// belongs to the largest set that agrees.
PooledVector<bool> largestConsensus(const PooledVector<Observation>& observations, const PooledMatrix& S,
                                    const Eigen::Matrix3d& noise, double threshold,
                                    const PooledVector<bool>& plausible);

} // namespace vi_ekf_slam::invariant

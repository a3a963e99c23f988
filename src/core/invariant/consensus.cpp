#include "vi_ekf_slam/core/invariant/consensus.hpp"

#include <cstddef>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam::invariant {

PooledVector<bool> largestConsensus(const PooledVector<Observation>& observations, const PooledMatrix& S,
                                    const Eigen::Matrix3d& noise, double threshold,
                                    const PooledVector<bool>& plausible) {
  const std::size_t count = observations.size();
  PooledVector<Eigen::Vector3d> weighted(count);
  for (std::size_t h = 0; h < count; ++h) {
    const Eigen::Matrix3d own = S.block<3, 3>(rowsOf(h), rowsOf(h));
    weighted[h] = solvePositive(own, observations[h].innovation);
  }
  // Column h: what is left of each observation after h's update, px^2.
  PooledMatrix residual(static_cast<Eigen::Index>(count), static_cast<Eigen::Index>(count));
  const auto squared = [](const Eigen::Vector3d& left) { // v stands for both rows
    return left[0] * left[0] + 2.0 * left[1] * left[1] + left[2] * left[2];
  };
  for (std::size_t h = 0; h < count; ++h) {
    // S holds the noise on its diagonal, a residual does not.
    const auto i = static_cast<Eigen::Index>(h);
    residual(i, i) = squared(noise * weighted[h]);
    for (std::size_t j = h + 1; j < count; ++j) {
      const Eigen::Matrix3d cross = S.block<3, 3>(rowsOf(j), rowsOf(h));
      const auto k = static_cast<Eigen::Index>(j);
      residual(k, i) = squared(observations[j].innovation - cross * weighted[h]);
      residual(i, k) = squared(observations[h].innovation - cross.transpose() * weighted[j]);
    }
  }

  PooledVector<bool> best(count, false), agrees(count, false);
  double best_score = 0.0;
  for (std::size_t h = 0; h < count; ++h) {
    if (!plausible[h]) continue;
    double score = 0.0;
    for (std::size_t j = 0; j < count; ++j) {
      const double left = residual(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(h));
      agrees[j] = plausible[j] && left < threshold;
      // Among sets of a size the tighter one wins.
      if (agrees[j]) score += 1.0 - 0.5 * left / threshold;
    }
    if (score > best_score) {
      best_score = score;
      best = agrees;
    }
  }
  return best;
}

} // namespace vi_ekf_slam::invariant

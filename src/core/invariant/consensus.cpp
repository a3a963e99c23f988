#include "vi_ekf_slam/core/invariant/consensus.hpp"

#include <Eigen/Cholesky>

namespace vi_ekf_slam::invariant {

std::vector<bool> largestConsensus(const std::vector<Observation>& observations, const Eigen::MatrixXd& S,
                                   const Eigen::Matrix3d& noise, double threshold,
                                   const std::vector<bool>& plausible) {
  const std::size_t count = observations.size();
  std::vector<bool> best(count, false), agrees(count, false);
  double best_score = 0.0;
  for (std::size_t h = 0; h < count; ++h) {
    if (!plausible[h]) continue;
    const Eigen::Index column = 3 * static_cast<Eigen::Index>(h);
    const Eigen::Matrix3d own = S.block<3, 3>(column, column);
    const Eigen::Vector3d weighted = own.llt().solve(observations[h].innovation);
    double score = 0.0;
    for (std::size_t j = 0; j < count; ++j) {
      Eigen::Vector3d left =
          observations[j].innovation - S.block<3, 3>(3 * static_cast<Eigen::Index>(j), column) * weighted;
      if (j == h) left += noise * weighted; // S holds the noise on its diagonal, a residual does not
      // v stands for both rows.
      const double residual = left[0] * left[0] + 2.0 * left[1] * left[1] + left[2] * left[2];
      agrees[j] = plausible[j] && residual < threshold;
      // Among sets of a size the tighter one wins.
      if (agrees[j]) score += 1.0 - 0.5 * residual / threshold;
    }
    if (score > best_score) {
      best_score = score;
      best = agrees;
    }
  }
  return best;
}

} // namespace vi_ekf_slam::invariant

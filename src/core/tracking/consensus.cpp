#include "vi_ekf_slam/core/tracking/consensus.hpp"

#include <cstddef>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {

std::vector<bool> largestConsensus(const Innovation& in, double threshold,
                                   const std::vector<bool>& plausible) {
  const std::size_t count = in.measurements().size();
  std::vector<Eigen::Vector3d> weighted(count), residuals(count);
  for (std::size_t h = 0; h < count; ++h) {
    residuals[h] = in.measurements()[h].residual();
    weighted[h] = solvePositive(Eigen::Matrix3d(in.S(h, h)), residuals[h]);
  }
  // Column h: what is left of each measurement after h's correction, px^2.
  Eigen::MatrixXd left(static_cast<Eigen::Index>(count), static_cast<Eigen::Index>(count));
  const auto squared = [](const Eigen::Vector3d& r) { // v stands for both rows
    return r[0] * r[0] + 2.0 * r[1] * r[1] + r[2] * r[2];
  };
  for (std::size_t h = 0; h < count; ++h) {
    // S holds the noise on its diagonal, a residual does not.
    const auto i = static_cast<Eigen::Index>(h);
    left(i, i) = squared(Eigen::Matrix3d(in.measurements()[h].noise()) * weighted[h]);
    for (std::size_t j = h + 1; j < count; ++j) {
      const Eigen::Matrix3d cross = in.S(j, h);
      const auto k = static_cast<Eigen::Index>(j);
      left(k, i) = squared(residuals[j] - cross * weighted[h]);
      left(i, k) = squared(residuals[h] - cross.transpose() * weighted[j]);
    }
  }
  std::vector<bool> best(count, false), agrees(count, false);
  double best_score = 0.0;
  for (std::size_t h = 0; h < count; ++h) {
    if (!plausible[h]) continue;
    double score = 0.0;
    for (std::size_t j = 0; j < count; ++j) {
      const double rest = left(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(h));
      agrees[j] = plausible[j] && rest < threshold;
      // Among sets of a size the tighter one wins.
      if (agrees[j]) score += 1.0 - 0.5 * rest / threshold;
    }
    if (score > best_score) {
      best_score = score;
      best = agrees;
    }
  }
  return best;
}

} // namespace vi_ekf_slam

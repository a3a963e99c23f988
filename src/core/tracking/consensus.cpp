#include "vi_ekf_slam/core/tracking/consensus.hpp"

#include <cstddef>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {

std::vector<bool> largestConsensus(const Innovation& in, double threshold,
                                   const std::vector<bool>& plausible) {
  const std::size_t count = in.measurements().size();
  const auto size = static_cast<Eigen::Index>(count);
  const Eigen::VectorXd residual = in.residual();
  // Column h: what is left of each measurement after h's correction.
  Eigen::MatrixXd left(size, size);
  Eigen::VectorXd rest;
  for (Eigen::Index h = 0; h < size; ++h) {
    const Eigen::Index row = 3 * h, behind = 3 * (size - h - 1);
    const Eigen::Vector3d weighted = solvePositive(Eigen::Matrix3d(in.S().block<3, 3>(row, row)),
                                                   Eigen::Vector3d(residual.segment<3>(row)));
    rest = residual;
    rest.head(row).noalias() -= in.S().block(row, 0, 3, row).transpose() * weighted;
    rest.tail(behind).noalias() -= in.S().block(row + 3, row, behind, 3) * weighted;
    // S holds the noise on its diagonal, a residual does not.
    rest.segment<3>(row) = in.measurements()[static_cast<std::size_t>(h)].noise() * weighted;
    rest = rest.cwiseAbs2(); // entry by entry
    const Eigen::Map<const Eigen::Matrix3Xd> uvu(rest.data(), 3, size);
    left.col(h) = uvu.row(0) + 2.0 * uvu.row(1) + uvu.row(2); // v stands for both rows
  }
  for (Eigen::Index j = 0; j < size; ++j)
    left.row(j) /= in.measurements()[static_cast<std::size_t>(j)].noise()(0, 0);
  std::vector<bool> best(count, false), agrees(count, false);
  double best_score = 0.0;
  for (std::size_t h = 0; h < count; ++h) {
    if (!plausible[h]) continue;
    double score = 0.0;
    for (std::size_t j = 0; j < count; ++j) {
      const double rest2 = left(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(h));
      agrees[j] = plausible[j] && rest2 < threshold;
      // Among sets of a size the tighter one wins.
      if (agrees[j]) score += 1.0 - 0.5 * rest2 / threshold;
    }
    if (score > best_score) {
      best_score = score;
      best = agrees;
    }
  }
  return best;
}

} // namespace vi_ekf_slam

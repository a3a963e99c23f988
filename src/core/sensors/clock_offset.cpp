#include "vi_ekf_slam/core/sensors/clock_offset.hpp"

#include <algorithm>
#include <cmath>

namespace vi_ekf_slam {

void ClockOffset::add(const Eigen::Vector3d& change, const Eigen::Vector3d& apart, double sigma) {
  const double weight = 1.0 / (sigma * sigma);
  ++count_;
  weight_ += weight;
  change_ += weight * change;
  apart_ += weight * apart;
  change_change_ += weight * change.squaredNorm();
  change_apart_ += weight * change.dot(apart);
  apart_apart_ += weight * apart.squaredNorm();
}

std::optional<ClockOffset::Estimate> ClockOffset::estimate() const {
  if (count_ < 2) return std::nullopt;
  // About the means, which are the bias's.
  const double xx = change_change_ - change_.squaredNorm() / weight_;
  const double xy = change_apart_ - change_.dot(apart_) / weight_;
  const double yy = apart_apart_ - apart_.squaredNorm() / weight_;
  if (!(xx > 1e-12 * change_change_)) return std::nullopt;
  const double tau = xy / xx, unknowns = 4.0;
  const double chi2 = std::max(0.0, yy - tau * xy) / (3.0 * count_ - unknowns);
  return Estimate{tau, std::sqrt(std::max(1.0, chi2) / xx)};
}

} // namespace vi_ekf_slam

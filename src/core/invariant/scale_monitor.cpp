#include "vi_ekf_slam/core/invariant/scale_monitor.hpp"

#include <algorithm>
#include <cmath>

namespace vi_ekf_slam::invariant {
namespace {

constexpr double kMinSpeed = 2.0;       // m/s; slower than this the ratio says nothing
constexpr double kMaxInnovation = 3.0;  // sigmas; larger ones are cut to this, so that no outlier decides
constexpr double kMaxErrorSigmas = 5.0; // of the prior: the correction cannot run away

} // namespace

void ScaleMonitor::compare(const Eigen::Vector3d& measured, const Eigen::Matrix3d& noise,
                           const Eigen::Vector3d& velocity, const Eigen::Matrix3d& covariance) {
  const double v2 = velocity.squaredNorm();
  if (!(v2 > kMinSpeed * kMinSpeed) || variance_ <= 0.0) return;
  // The filter's velocity carries the factor that is in force; the error sought is the whole one.
  const double seen = velocity.dot(measured) / v2 * factor() - 1.0;
  const double noise_variance = velocity.dot((noise + covariance) * velocity) / (v2 * v2);
  const double sigma = std::sqrt(variance_ + noise_variance);
  const double innovation = std::clamp(seen - error_, -kMaxInnovation * sigma, kMaxInnovation * sigma);
  const double gain = variance_ / (sigma * sigma);
  const double limit = kMaxErrorSigmas * prior_sigma_;
  error_ = std::clamp(error_ + gain * innovation, -limit, limit);
  variance_ *= 1.0 - gain;
  if (std::abs(error_) > significance_ * std::sqrt(variance_)) proven_ = true;
}

} // namespace vi_ekf_slam::invariant

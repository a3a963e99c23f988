#include "vi_ekf_slam/core/observation/scene_disparities.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kFewest = 8; // of which a variance is known to its half

} // namespace

/// A variance of n draws is known to sqrt(2 / n) of itself; half of that is the least that is taken for one
/// of true disparities, since none at all would be a wall that faces the camera.
std::optional<SceneDisparities> SceneDisparities::of(Filter& filter, const std::vector<double>& disparities,
                                                     double noise_variance) {
  if (disparities.size() < kFewest) return std::nullopt;
  const Eigen::Map<const Eigen::ArrayXd> d(disparities.data(), static_cast<Eigen::Index>(disparities.size()));
  const double n = static_cast<double>(d.size()), mean = d.mean();
  const double variance = (d - mean).square().sum() / (n - 1.0);
  const Handle variable = filter.augment(Chart::kVector, Eigen::VectorXd::Constant(1, mean),
                                         Eigen::MatrixXd::Constant(1, 1, variance / n));
  return SceneDisparities(variable, std::max(variance - noise_variance, 0.5 * std::sqrt(2.0 / n) * variance));
}

SceneDisparities::Predicted SceneDisparities::predict(const Filter& filter, const StereoPixels& pixels,
                                                      double sigma) const {
  const double noise = 2.0 * sigma * sigma, k = variance_ / (variance_ + noise);
  const double mean = filter.variables().mean(mean_)[0];
  const double half = 0.5 * (mean + k * (pixels[0] - pixels[2] - mean)),
               middle = 0.5 * (pixels[0] + pixels[2]);
  Predicted result{{middle + half, pixels[1], middle - half, pixels[3]},
                   sigma * sigma * Eigen::Matrix4d::Identity(),
                   1.0 - k};
  // The middle's variance is sigma^2 / 2, as it was, that of the disparity k noise.
  result.noise(0, 0) = result.noise(2, 2) = 0.5 * sigma * sigma + 0.25 * k * noise;
  result.noise(0, 2) = result.noise(2, 0) = 0.5 * sigma * sigma - 0.25 * k * noise;
  return result;
}

} // namespace vi_ekf_slam

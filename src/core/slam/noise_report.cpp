#include "vi_ekf_slam/core/slam/noise_report.hpp"

#include <cmath>
#include <sstream>

namespace vi_ekf_slam {
namespace {

/// By Stream.
std::array<StreamNoise, kStreamCount> configuredNoise(const Config& config) {
  if (config.estimator == EstimatorType::kPaper) {
    // The motion noise enters as tau w (eq. 2): a step's W stands for this noise of the twist.
    const Vector6d variance = config.paper.motion_noise / (config.paper.step_s * config.paper.step_s);
    return {{{"gyro", std::sqrt(variance.tail<3>().mean()), "rad/s", "paper/motion_noise"},
             {"velocity", std::sqrt(variance.head<3>().mean()), "m/s", "paper/motion_noise"},
             {"pixels", std::sqrt(config.paper.pixel_noise), "px", "paper/pixel_noise"}}};
  }
  const std::string without = ": its messages give no covariance";
  const InvariantConfig& invariant = config.invariant;
  return {{{"gyro", invariant.motion.gyro_sigma, "rad/s", "invariant/gyro_sigma" + without},
           {"velocity", invariant.motion.velocity_sigma, "m/s", "invariant/velocity_sigma" + without},
           {"pixels", invariant.stereo.pixel_sigma, "px", "invariant/pixel_sigma"}}};
}

std::optional<Eigen::Matrix3d> covarianceOf(const GyroSample& sample) { return sample.covariance; }
std::optional<Eigen::Matrix3d> covarianceOf(const VelocitySample& sample) { return sample.covariance; }
std::optional<Eigen::Matrix3d> covarianceOf(const StereoFrame&) { return std::nullopt; }

} // namespace

std::string toText(const StreamNoise& noise) {
  std::ostringstream text;
  text << noise.stream << " " << noise.sigma << " " << noise.unit << " (" << noise.source << ")";
  return text.str();
}

NoiseReport::NoiseReport(const Config& config)
    : takes_covariances_(config.estimator == EstimatorType::kInvariant),
      configured_(configuredNoise(config)) {}

std::optional<StreamNoise> NoiseReport::note(const Measurement& measurement) {
  const auto stream = static_cast<std::size_t>(streamOf(measurement));
  const auto covariance = std::visit([](const auto& sample) { return covarianceOf(sample); }, measurement);
  const bool given = covariance && takes_covariances_;
  if (noted_[stream][given]) return std::nullopt;
  noted_[stream][given] = true;
  StreamNoise noise = configured_[stream];
  if (given) {
    noise.sigma = std::sqrt(covariance->trace() / 3.0);
    noise.source = "from its messages";
  }
  if (used_[stream]) {
    used_[stream]->source += "; later " + toText(noise);
  } else {
    used_[stream] = noise;
  }
  return noise;
}

std::vector<StreamNoise> NoiseReport::streams() const {
  std::vector<StreamNoise> streams;
  for (const auto& noise : used_) {
    if (noise) streams.push_back(*noise);
  }
  return streams;
}

} // namespace vi_ekf_slam

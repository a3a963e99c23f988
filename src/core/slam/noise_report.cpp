#include "vi_ekf_slam/core/slam/noise_report.hpp"

#include <cmath>

#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kImuIntervals = 10; // whose mean is the IMU's period
constexpr int kDigits = 6;

} // namespace

std::string toText(const StreamNoise& noise) {
  return noise.stream + " " + rounded(noise.sigma, kDigits) + " " + noise.unit + " (" + noise.source + ")";
}

NoiseReport::NoiseReport(const Config& config)
    : inertial_(config.invariant.inertial),
      takes_covariances_(config.estimator == EstimatorType::kInvariant) {
  if (!takes_covariances_) {
    // The motion noise enters as tau w (eq. 2): a step's W stands for this noise of the twist.
    const Vector6d variance = config.paper.motion_noise / (config.paper.step_s * config.paper.step_s);
    gyro_.configured = {"gyro", std::sqrt(variance.tail<3>().mean()), "rad/s", "paper/motion_noise"};
    velocity_.configured = {"velocity", std::sqrt(variance.head<3>().mean()), "m/s", "paper/motion_noise"};
    pixels_.configured = {"pixels", std::sqrt(config.paper.pixel_noise), "px", "paper/pixel_noise"};
    return;
  }
  const std::string without = ": its messages give no covariance";
  const InvariantConfig& invariant = config.invariant;
  gyro_.configured = {"gyro", invariant.motion.gyro_sigma, "rad/s", "invariant/gyro_sigma" + without};
  velocity_.configured = {"velocity", invariant.motion.velocity_sigma, "m/s",
                          "invariant/velocity_sigma" + without};
  pixels_.configured = {"pixels", invariant.stereo.pixel_sigma, "px", "invariant/pixel_sigma"};
}

/// What holds: a calibration file, the messages, imu_noise (ImuTrack::over).
void NoiseReport::setInertial(bool inertial) {
  is_inertial_ = inertial;
  if (!inertial) return;
  const std::string source = inertial_.noise_given ? "inertial/imu_calibration: " + inertial_.noise_file
                                                   : "inertial/imu_noise: its messages give no covariance";
  gyro_.configured = {"gyro", inertial_.noise.gyro_density, "rad/s/sqrt(Hz)", source};
  accelerometer_.configured = {"accelerometer", inertial_.noise.accelerometer_density, "m/s^2/sqrt(Hz)",
                               source};
}

void NoiseReport::noteSensor(Sensor& sensor, const std::optional<Eigen::Matrix3d>& covariance,
                             std::vector<StreamNoise>& news) {
  const bool is_density = is_inertial_ && (&sensor == &gyro_ || &sensor == &accelerometer_);
  const bool given = covariance && takes_covariances_ && !(is_density && inertial_.noise_given);
  if (sensor.noted[given] || (given && is_density && imu_period_ == 0.0)) return;
  sensor.noted[given] = true;
  StreamNoise noise = sensor.configured;
  if (given) {
    noise.sigma = std::sqrt(covariance->trace() / 3.0 * (is_density ? imu_period_ : 1.0));
    noise.source = is_density ? "from its messages' covariance at " +
                                    rounded(std::round(1.0 / imu_period_), kDigits) + " Hz"
                              : "from its messages";
  }
  if (sensor.used) {
    sensor.used->source += "; later " + toText(noise);
  } else {
    sensor.used = noise;
  }
  news.push_back(noise);
}

void NoiseReport::noteImu(const ImuSample& sample, std::vector<StreamNoise>& news) {
  if (is_inertial_ && imu_period_ == 0.0) {
    if (!first_imu_ || sample.stamp <= *first_imu_) {
      first_imu_ = sample.stamp;
      imu_intervals_ = 0;
    } else if (++imu_intervals_ == kImuIntervals) {
      imu_period_ = secondsBetween(*first_imu_, sample.stamp) / static_cast<double>(kImuIntervals);
    }
  }
  noteSensor(gyro_, sample.covariance, news);
  if (is_inertial_ && sample.acceleration) noteSensor(accelerometer_, sample.acceleration_covariance, news);
}

std::vector<StreamNoise> NoiseReport::note(const Measurement& measurement) {
  std::vector<StreamNoise> news;
  if (const auto* imu = std::get_if<ImuSample>(&measurement)) {
    noteImu(*imu, news);
  } else if (const auto* velocity = std::get_if<VelocitySample>(&measurement)) {
    noteSensor(velocity_, velocity->covariance, news);
  } else {
    noteSensor(pixels_, std::nullopt, news);
  }
  return news;
}

std::vector<StreamNoise> NoiseReport::streams() const {
  std::vector<StreamNoise> streams;
  for (const Sensor* sensor : {&gyro_, &accelerometer_, &velocity_, &pixels_}) {
    if (sensor->used) streams.push_back(*sensor->used);
  }
  return streams;
}

} // namespace vi_ekf_slam

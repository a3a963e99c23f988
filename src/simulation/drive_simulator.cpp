#include "vi_ekf_slam/simulation/drive_simulator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vi_ekf_slam::simulation {
namespace {

DriveOptions checked(const DriveOptions& options) {
  checkDriveOptions(options);
  return options;
}

std::unique_ptr<Motion> makeMotion(const DriveOptions& options) {
  if (options.motion == MotionModel::kCarDrive) return std::make_unique<CarMotion>(options);
  return std::make_unique<ProcessMotion>(options);
}

std::unique_ptr<Scene> makeScene(const DriveOptions& options, const View& view) {
  if (options.motion == MotionModel::kCarDrive) return std::make_unique<StreetScene>(options, view);
  return std::make_unique<OpenScene>(options, view);
}

/// Of a sample; nothing when it is exact, since a covariance must be positive definite.
std::optional<Eigen::Matrix3d> covarianceOf(double sigma) {
  if (sigma == 0.0) return std::nullopt;
  return Eigen::Matrix3d(sigma * sigma * Eigen::Matrix3d::Identity());
}

double lapDistance(const DriveOptions& options) {
  return options.laps * BlockPath(options.block_length, options.block_width).perimeter();
}

} // namespace

DriveSimulator::DriveSimulator(const DriveOptions& options)
    : options_(checked(options)),
      view_(makeView(options)),
      motion_(makeMotion(options)),
      scene_(makeScene(options, view_)),
      traffic_(options),
      front_end_(options, view_, *scene_),
      imu_random_(options.seed, RandomStream::kImu),
      samples_per_frame_(static_cast<std::size_t>(std::lround(options.imuRate() / options.frame_rate))) {
  drawBiases();
}

void DriveSimulator::drawBiases() {
  Random random(options_.seed, RandomStream::kBiases);
  for (int i = 0; i < 3; ++i) {
    const double magnitude = random.sign() * random.uniform(options_.gyro_bias_min, options_.gyro_bias_max);
    const double normal = random.normal() * options_.gyro_bias_sigma;
    gyro_bias_[i] = options_.gyro_bias_sigma > 0.0 ? normal : magnitude;
  }
  velocity_bias_ = options_.velocity_bias_sigma * random.normal3();
}

Stamp DriveSimulator::sampleStamp(std::size_t sample) const {
  const double since_start = static_cast<double>(sample) / options_.imuRate();
  // Whole seconds apart from the rest: their product with 1e9 would not fit a double's 53 bits.
  const double whole = std::floor(options_.start_time);
  const Stamp start = fromSeconds(1.0) * static_cast<Stamp>(whole) + fromSeconds(options_.start_time - whole);
  return start + fromSeconds(since_start);
}

double DriveSimulator::progress() const {
  const double done = options_.duration > 0.0
                          ? static_cast<double>(index_) / (options_.duration * options_.frame_rate)
                          : motion_->distance() / lapDistance(options_);
  return std::min(1.0, done);
}

std::optional<DriveStep> DriveSimulator::next() {
  if (progress() >= 1.0) return std::nullopt;
  DriveStep step;
  step.index = index_++;
  const std::size_t first_sample = step.index * samples_per_frame_;
  step.stamp = sampleStamp(first_sample);
  step.world_T_imu = motion_->world_T_imu();
  FrontEnd::Result seen = front_end_.process(step.stamp, step.world_T_imu, traffic_.objects());
  step.frame = std::move(seen.frame);
  step.truth = std::move(seen.truth);
  step.stale = seen.stale;
  for (std::size_t j = first_sample; j < first_sample + samples_per_frame_; ++j) {
    const Stamp stamp = sampleStamp(j);
    const double dt = secondsBetween(stamp, sampleStamp(j + 1));
    const Vector6d twist = motion_->step(dt);
    traffic_.step(dt, motion_->world_T_imu(), twist);
    step.true_twist.push_back({stamp, twist});
    const Eigen::Vector3d gyro = twist.tail<3>() + gyro_bias_ + options_.gyro_sigma * imu_random_.normal3();
    const Eigen::Vector3d velocity =
        twist.head<3>() + velocity_bias_ + options_.velocity_sigma * imu_random_.normal3();
    step.gyro.push_back({stamp, gyro, covarianceOf(options_.gyro_sigma)});
    step.velocity.push_back({stamp, velocity, covarianceOf(options_.velocity_sigma)});
  }
  return step;
}

Drive simulateDrive(const DriveOptions& options) {
  DriveSimulator simulator(options);
  Drive drive;
  drive.options = options;
  drive.rig = simulator.rig();
  drive.gyro_bias = simulator.gyroBias();
  drive.velocity_bias = simulator.velocityBias();
  while (std::optional<DriveStep> step = simulator.next()) {
    for (const ObservationTruth& truth : step->truth) {
      if (truth.kind != ObservationKind::kMoving) drive.static_points[truth.point] = truth.world;
    }
    drive.steps.push_back(std::move(*step));
  }
  return drive;
}

std::vector<Measurement> measurementsOf(const DriveStep& step) {
  std::vector<Measurement> measurements;
  for (std::size_t j = 0; j < step.gyro.size(); ++j) {
    measurements.emplace_back(step.gyro[j]);
    measurements.emplace_back(step.velocity[j]);
    if (j == 0) measurements.emplace_back(step.frame);
  }
  return measurements;
}

} // namespace vi_ekf_slam::simulation

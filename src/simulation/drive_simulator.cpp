#include "vi_ekf_slam/simulation/drive_simulator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "vi_ekf_slam/simulation/inertial/handheld.hpp"
#include "vi_ekf_slam/simulation/inertial/smooth_car.hpp"
#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"

namespace vi_ekf_slam::simulation {
namespace {

DriveOptions checked(const DriveOptions& options) {
  checkDriveOptions(options);
  return options;
}

std::unique_ptr<Motion> makeMotion(const DriveOptions& options) {
  switch (options.motion) {
    case MotionModel::kCarDrive:
      return std::make_unique<CarMotion>(options);
    case MotionModel::kProcessModel:
      return std::make_unique<ProcessMotion>(options);
    case MotionModel::kHandheld:
      return std::make_unique<TrajectoryMotion>(std::make_unique<HandheldTrajectory>(options));
    case MotionModel::kInertialCar:
      return std::make_unique<TrajectoryMotion>(std::make_unique<SmoothCarTrajectory>(options));
  }
  throw std::invalid_argument("motion is none of the enumeration");
}

std::unique_ptr<Scene> makeScene(const DriveOptions& options, const View& view) {
  if (options.motion == MotionModel::kProcessModel) return std::make_unique<OpenScene>(options, view);
  if (options.motion == MotionModel::kHandheld)
    return std::make_unique<RoomScene>(options, view, HandheldTrajectory(options).extent());
  return std::make_unique<StreetScene>(options, view);
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
      now_(stampOf(0, options.frame_rate)) {
  drawBiases();
  if (options_.hasRawImu()) raw_imu_.emplace(options_, gyro_bias_);
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

/// Of number `index` of what comes at `rate` Hz, `offset` s after the start.
Stamp DriveSimulator::stampOf(std::size_t index, double rate, double offset) const {
  const double since_start = static_cast<double>(index) / rate + offset;
  // Whole seconds apart from the rest: their product with 1e9 would not fit a double's 53 bits.
  const double whole = std::floor(options_.start_time);
  const Stamp start = fromSeconds(1.0) * static_cast<Stamp>(whole) + fromSeconds(options_.start_time - whole);
  return start + fromSeconds(since_start);
}

Stamp DriveSimulator::frameStamp(std::size_t index) const {
  const double offset = options_.hasRawImu() ? options_.frame_offset / options_.imuRate() : 0.0;
  return stampOf(index, options_.frame_rate, offset);
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
  step.stamp = frameStamp(step.index);
  takeSamplesBefore(step.stamp, step);
  moveTo(step.stamp);
  step.world_T_imu = motion_->world_T_imu();
  FrontEnd::Result seen = front_end_.process(step.stamp, step.world_T_imu, traffic_.objects());
  step.frame = std::move(seen.frame);
  step.truth = std::move(seen.truth);
  step.stale = seen.stale;
  const Stamp next_frame = frameStamp(index_);
  takeSamplesBefore(next_frame, step);
  moveTo(next_frame);
  return step;
}

void DriveSimulator::takeSamplesBefore(Stamp stamp, DriveStep& step) {
  for (Stamp sample; (sample = stampOf(samples_, options_.imuRate())) < stamp;) {
    moveTo(sample);
    takeSample(step);
  }
}

std::optional<TrueState> DriveSimulator::stateAt(Stamp stamp) const {
  const std::optional<Kinematics> body = motion_->kinematics(secondsBetween(now_, stamp));
  if (!body || !raw_imu_) return std::nullopt;
  return TrueState{stamp, body->world_T_imu, body->velocity, raw_imu_->gyroBias(),
                   raw_imu_->accelerometerBias()};
}

void DriveSimulator::moveTo(Stamp stamp) {
  if (stamp <= now_) return;
  const double dt = secondsBetween(now_, stamp);
  motion_->move(dt);
  traffic_.step(dt, motion_->world_T_imu(), twist_);
  now_ = stamp;
}

void DriveSimulator::takeSample(DriveStep& step) {
  ++samples_;
  twist_ = motion_->begin(secondsBetween(now_, stampOf(samples_, options_.imuRate())));
  step.true_twist.push_back(twist_);
  if (raw_imu_) {
    step.gyro.push_back(raw_imu_->measure(now_, *motion_->kinematics()));
    if (!options_.velocity_samples) return;
  } else {
    const Eigen::Vector3d gyro = twist_.tail<3>() + gyro_bias_ + options_.gyro_sigma * imu_random_.normal3();
    step.gyro.push_back({now_, gyro, covarianceOf(options_.gyro_sigma)});
  }
  const Eigen::Vector3d velocity =
      twist_.head<3>() + velocity_bias_ + options_.velocity_sigma * imu_random_.normal3();
  step.velocity.push_back({now_, velocity, covarianceOf(options_.velocity_sigma)});
}

Drive simulateDrive(const DriveOptions& options) {
  DriveSimulator simulator(options);
  Drive drive;
  drive.options = options;
  drive.rig = simulator.rig();
  drive.gyro_bias = simulator.gyroBias();
  drive.velocity_bias = simulator.velocityBias();
  while (std::optional<DriveStep> step = simulator.next()) drive.steps.push_back(std::move(*step));
  return drive;
}

std::vector<Measurement> measurementsOf(const DriveStep& step) {
  std::vector<Measurement> measurements;
  std::size_t j = 0;
  const auto takeUntil = [&](Stamp last) {
    for (; j < step.gyro.size() && step.gyro[j].stamp <= last; ++j) {
      measurements.emplace_back(step.gyro[j]);
      if (j < step.velocity.size()) measurements.emplace_back(step.velocity[j]);
    }
  };
  takeUntil(step.stamp);
  measurements.emplace_back(step.frame);
  takeUntil(std::numeric_limits<Stamp>::max());
  return measurements;
}

} // namespace vi_ekf_slam::simulation

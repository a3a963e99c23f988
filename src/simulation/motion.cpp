#include "vi_ekf_slam/simulation/motion.hpp"

#include <algorithm>
#include <cmath>

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kAcceleration = 1.5;   // m/s^2
constexpr double kStopTolerance = 0.05; // m

double brakingSpeed(double final_speed, double distance) {
  return std::sqrt(final_speed * final_speed + 2.0 * kAcceleration * std::max(0.0, distance));
}

} // namespace

CarMotion::CarMotion(const DriveOptions& options)
    : path_(options.block_length, options.block_width),
      world_T_path_(path_.path_T_imu(0.0).inverse()),
      straight_speed_(options.speed),
      corner_speed_(std::min(options.corner_speed, options.speed)),
      rest_(options.standing_start),
      corner_stop_(options.corner_stop),
      stop_station_(path_.distanceToCorner(0.0)) {
  if (rest_ <= 0.0) speed_ = allowedSpeed();
}

double CarMotion::allowedSpeed() const {
  double speed = std::min(straight_speed_, brakingSpeed(corner_speed_, path_.distanceToCorner(station_)));
  if (corner_stop_ > 0.0) speed = std::min(speed, brakingSpeed(0.0, stop_station_ - station_));
  return speed;
}

Vector6d CarMotion::begin(double dt) {
  if (corner_stop_ > 0.0 && stop_station_ - station_ < kStopTolerance) {
    rest_ = corner_stop_;
    corner_stop_ = 0.0;
    speed_ = 0.0;
  }
  if (rest_ > 1e-9) {
    rest_ -= dt;
    twist_.setZero();
    return twist_;
  }
  speed_ = std::min(speed_ + kAcceleration * dt, allowedSpeed());
  const SE3 next = world_T_path_ * path_.path_T_imu(station_ + speed_ * dt);
  twist_ = (world_T_imu_.inverse() * next).Log() / dt;
  return twist_;
}

void CarMotion::move(double dt) {
  if (twist_.isZero(0.0)) return;
  station_ += speed_ * dt;
  world_T_imu_ = (world_T_imu_ * SE3::Exp(dt * twist_)).normalized();
}

ProcessMotion::ProcessMotion(const DriveOptions& options)
    : random_(options.seed, RandomStream::kMotion), nominal_(Vector6d::Zero()), decay_(options.twist_decay) {
  nominal_[0] = options.speed;
  twist_ = nominal_;
  noise_ << options.noise_forward, options.noise_lateral, options.noise_vertical, options.noise_rotation,
      options.noise_rotation, options.noise_rotation;
}

void ProcessMotion::move(double dt) {
  const Vector6d deviation = twist_ - nominal_;
  Vector6d change, mean_change; // w2 and w1
  for (int i = 0; i < 6; ++i) {
    change[i] = noise_[i] * std::sqrt(dt) * random_.normal();
    mean_change[i] = 0.5 * change[i] + noise_[i] * std::sqrt(dt / 12.0) * random_.normal();
  }
  const double lost = decay_ > 0.0 ? -std::expm1(-dt / decay_) : 0.0; // of the deviation, by the step's end
  const double mean_kept = decay_ > 0.0 ? lost * decay_ / dt : 1.0;
  const Vector6d mean_twist = nominal_ + mean_kept * deviation + mean_change;
  world_T_imu_ = (world_T_imu_ * SE3::Exp(dt * mean_twist)).normalized();
  twist_ = nominal_ + (1.0 - lost) * deviation + change;
}

} // namespace vi_ekf_slam::simulation

#include "vi_ekf_slam/simulation/inertial/inertial_sensor.hpp"

#include <Eigen/LU>
#include <cmath>

#include "vi_ekf_slam/simulation/inertial/trajectory.hpp"

namespace vi_ekf_slam::simulation {

InertialSensor::InertialSensor(const DriveOptions& options, const Eigen::Vector3d& gyro_bias)
    : gyro_walk_(options.gyro_walk / std::sqrt(options.imuRate())),
      accelerometer_walk_(options.accelerometer_walk / std::sqrt(options.imuRate())),
      gyro_sigma_(options.gyro_density * std::sqrt(options.imuRate())),
      accelerometer_sigma_(options.accelerometer_density * std::sqrt(options.imuRate())),
      noise_random_(options.seed, RandomStream::kImu),
      walk_random_(options.seed, RandomStream::kBiasWalks),
      gyro_bias_(gyro_bias),
      accelerometer_bias_(options.accelerometer_bias_sigma * walk_random_.normal3()) {
  Random random(options.seed, RandomStream::kImuScale);
  Eigen::Matrix3d M;
  for (Eigen::Index k = 0; k < 3; ++k) M.col(k) = options.accelerometer_scale_sigma * random.normal3();
  accelerometer_scale_ = (Eigen::Matrix3d::Identity() - M).inverse();
}

ImuSample InertialSensor::measure(Stamp stamp, const Kinematics& body) {
  if (!first_) {
    gyro_bias_ += gyro_walk_ * walk_random_.normal3();
    accelerometer_bias_ += accelerometer_walk_ * walk_random_.normal3();
  }
  first_ = false;
  ImuSample sample;
  sample.stamp = stamp;
  sample.angular_velocity = body.angular_velocity + gyro_bias_ + gyro_sigma_ * noise_random_.normal3();
  sample.acceleration = accelerometer_scale_ * specificForce(body) + accelerometer_bias_ +
                        accelerometer_sigma_ * noise_random_.normal3();
  // Without noise there is none to state: a covariance must be positive definite.
  if (gyro_sigma_ > 0.0) sample.covariance = gyro_sigma_ * gyro_sigma_ * Eigen::Matrix3d::Identity();
  if (accelerometer_sigma_ > 0.0)
    sample.acceleration_covariance =
        accelerometer_sigma_ * accelerometer_sigma_ * Eigen::Matrix3d::Identity();
  return sample;
}

} // namespace vi_ekf_slam::simulation

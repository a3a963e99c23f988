#include "vi_ekf_slam/core/sensors/lever_arm.hpp"

#include <Eigen/Geometry>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFresh = 0.5;            // s; an older rate is not of that moment
constexpr double kUnknownRateSigma = 1.0; // rad/s
constexpr double kMaxRateVariance = 1e6;  // (rad/s)^2; more says nothing, and could overflow

} // namespace

VelocitySample LeverArm::atImu(const VelocitySample& sample) const {
  if (sample.lever_arm.isZero(0.0)) return sample;
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rate_covariance = isotropic(kUnknownRateSigma);
  if (gyro_ && secondsBetween(gyro_->stamp, sample.stamp) <= kFresh &&
      !(gyro_->covariance && gyro_->covariance->trace() > kMaxRateVariance)) {
    rate = gyro_->angular_velocity;
    rate_covariance = gyro_->covariance.value_or(isotropic(gyro_sigma_));
  }
  const Eigen::Matrix3d by_rate = so3::hat(sample.lever_arm);
  VelocitySample carried{sample.stamp, sample.linear_velocity - rate.cross(sample.lever_arm), {}};
  carried.covariance = sample.covariance.value_or(isotropic(velocity_sigma_));
  *carried.covariance += by_rate * rate_covariance * by_rate.transpose();
  return carried;
}

} // namespace vi_ekf_slam

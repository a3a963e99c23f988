#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Angular velocity of the IMU in its own frame, rad/s.
struct GyroSample {
  Stamp stamp = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();
  std::optional<Eigen::Matrix3d> covariance; ///< (rad/s)^2 of this sample; absent: the configured noise holds
};

/// Linear velocity of a point of the vehicle along the axes of the IMU frame, m/s.
struct VelocitySample {
  Stamp stamp = 0;
  Eigen::Vector3d linear_velocity = Eigen::Vector3d::Zero();
  std::optional<Eigen::Matrix3d> covariance; ///< (m/s)^2 of this sample; absent: the configured noise holds
  Eigen::Vector3d lever_arm =
      Eigen::Vector3d::Zero(); ///< m, of the point in the IMU frame; 0: the IMU itself
};

/// What is known beforehand of the constant biases of what is measured of the twist: (velocity in m/s, gyro
/// in rad/s), IMU frame.
struct TwistBias {
  Vector6d mean = Vector6d::Zero();
  Vector6d sigma = Vector6d::Zero(); ///< standard deviations
};

using FeatureId = std::uint64_t;

struct StereoFeatureObservation {
  FeatureId id = 0;
  StereoPixels pixels = StereoPixels::Zero();
};

/// What one exposure of the stereo pair saw. Ids are unique within a frame.
struct StereoFrame {
  Stamp stamp = 0;
  std::vector<StereoFeatureObservation> features;
};

using Measurement = std::variant<GyroSample, VelocitySample, StereoFrame>;

/// The streams that a Measurement can come from, in the order in which equal stamps are processed.
enum class Stream : std::size_t { kGyro = 0, kVelocity = 1, kStereo = 2 };
constexpr std::size_t kStreamCount = std::variant_size_v<Measurement>;

inline Stream streamOf(const Measurement& m) { return static_cast<Stream>(m.index()); }

inline Stamp stampOf(const Measurement& m) {
  return std::visit([](const auto& sample) { return sample.stamp; }, m);
}

} // namespace vi_ekf_slam

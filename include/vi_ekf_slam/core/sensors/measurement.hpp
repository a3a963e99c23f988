#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// Angular velocity of the IMU, rad/s, and, where it has accelerometers, its specific force, m/s^2 (at rest
/// 9.81 upwards), both in its own frame.
struct ImuSample {
  Stamp stamp = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();
  std::optional<Eigen::Matrix3d> covariance; ///< (rad/s)^2 of this sample; absent: the configured noise holds
  std::optional<Eigen::Vector3d> acceleration = std::nullopt;
  std::optional<Eigen::Matrix3d> acceleration_covariance = std::nullopt; ///< (m/s^2)^2, as `covariance`
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

/// 256 bits of what a point looks like, near in Hamming distance where it looks alike.
using Descriptor = std::array<std::uint8_t, 32>;

struct StereoFeatureObservation {
  FeatureId id = 0;
  StereoPixels pixels = StereoPixels::Zero();
  double sigma = 0.0; ///< px, standard deviation of each of the four; 0: as configured
  /// px/s^0.5, root spectral density of the random walk by which its track slides over what it shows, alike
  /// in both images.
  double walk = 0.0;
  std::optional<Descriptor> descriptor = std::nullopt; ///< of the left image
};

/// What one exposure of the stereo pair saw. Ids are unique within a frame.
struct StereoFrame {
  Stamp stamp = 0;
  std::vector<StereoFeatureObservation> features;
  double time_offset = 0.0; ///< s, by which the stamp was moved on from the camera's clock to the IMU's
};

using Measurement = std::variant<ImuSample, VelocitySample, StereoFrame>;

/// The streams that a Measurement can come from, in the order in which equal stamps are processed.
enum class Stream : std::size_t { kImu = 0, kVelocity = 1, kStereo = 2 };
constexpr std::size_t kStreamCount = std::variant_size_v<Measurement>;
/// In the order of Stream: of the sensors, as counts are named, and of the topics.
constexpr std::array<const char*, kStreamCount> kSensorNames = {"gyro", "velocity", "stereo"},
                                                kTopicNames = {"imu", "velocity", "features"};

inline Stream streamOf(const Measurement& m) { return static_cast<Stream>(m.index()); }

inline Stamp stampOf(const Measurement& m) {
  return std::visit([](const auto& sample) { return sample.stamp; }, m);
}

} // namespace vi_ekf_slam

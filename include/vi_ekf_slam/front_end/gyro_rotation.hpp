#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// How the IMU has turned between two stamps, from its gyro.
class GyroRotation {
 public:
  /// Samples that are older than the last one, or not finite, are not taken.
  void add(const ImuSample& sample);
  /// Samples before `stamp` are not asked for any more.
  void forgetBefore(Stamp stamp);

  /// from_R_to: the rate is interpolated between samples. Nothing where they do not reach over both stamps.
  std::optional<Eigen::Matrix3d> between(Stamp from, Stamp to) const;

 private:
  struct Sample {
    Stamp stamp;
    Eigen::Vector3d rate; ///< rad/s
  };

  Eigen::Vector3d rateAt(Stamp stamp) const;

  std::deque<Sample> samples_;
};

} // namespace vi_ekf_slam

#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"

namespace vi_ekf_slam {

/// Which noise the estimator takes a sensor to have, and from where.
struct StreamNoise {
  std::string stream;
  /// Standard deviation per axis, or root spectral density where the unit has a sqrt(Hz); of axes that
  /// differ, their root mean square.
  double sigma = 0.0;
  std::string unit;
  std::string source;
};

/// "gyro 0.05 rad/s (from its messages)".
std::string toText(const StreamNoise& noise);

/// Collects the noise of each sensor from the first measurement that is used, for a run's log and summary.
class NoiseReport {
 public:
  explicit NoiseReport(const Config& config);

  /// Whether gyro and accelerometer are inputs of an inertial model, whose noise is a density. Known before
  /// the first measurement.
  void setInertial(bool inertial);
  /// A measurement is used. What is new by it: a sensor, or another source of its noise.
  std::vector<StreamNoise> note(const Measurement& measurement);
  /// Those that were used: gyro, accelerometer, velocity, pixels. A source that came later is named behind
  /// the first.
  std::vector<StreamNoise> streams() const;

 private:
  struct Sensor {
    StreamNoise configured;
    std::optional<StreamNoise> used;
    std::array<bool, 2> noted{}; ///< by whether the measurement had a covariance
  };

  void noteSensor(Sensor& sensor, const std::optional<Eigen::Matrix3d>& covariance,
                  std::vector<StreamNoise>& news);
  void noteImu(const ImuSample& sample, std::vector<StreamNoise>& news);

  Inertial::Options inertial_;
  bool is_inertial_ = false;
  bool takes_covariances_; ///< from messages that have one
  Sensor gyro_, accelerometer_, velocity_, pixels_;
  std::optional<Stamp> first_imu_;
  std::size_t imu_intervals_ = 0;
  double imu_period_ = 0.0; ///< s, mean; 0: not known yet
};

} // namespace vi_ekf_slam

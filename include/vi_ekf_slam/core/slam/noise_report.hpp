#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Which noise the estimator takes a stream to have, and from where.
struct StreamNoise {
  std::string stream;
  double sigma = 0.0; ///< standard deviation per axis; of axes that differ, their root mean square
  std::string unit;
  std::string source;
};

/// "gyro 0.05 rad/s (from its messages)".
std::string toText(const StreamNoise& noise);

/// Collects the noise of each stream from the first measurement that is used, for a run's log and summary.
class NoiseReport {
 public:
  explicit NoiseReport(const Config& config);

  /// A measurement is used. What is new by it: a stream, or another source of its noise.
  std::optional<StreamNoise> note(const Measurement& measurement);
  /// Those that were used, in the order of Stream. A source that came later is named behind the first.
  std::vector<StreamNoise> streams() const;

 private:
  bool takes_covariances_; ///< from messages that have one
  std::array<StreamNoise, kStreamCount> configured_;
  std::array<std::optional<StreamNoise>, kStreamCount> used_;
  std::array<std::array<bool, 2>, kStreamCount> noted_{}; ///< by whether the measurement had a covariance
};

} // namespace vi_ekf_slam

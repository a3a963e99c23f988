#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_study.hpp"

namespace vi_ekf_slam {

struct MonteCarloOptions {
  std::string config;
  std::string output;
  std::size_t seeds = 50;
  std::uint64_t first_seed = 1;
  unsigned jobs = 1;
  simulation::DriveOptions drive;
  simulation::InertialStudy study;
  std::vector<double> frame_rates, imu_rates;     ///< Hz; where there are any, a study of each pair
  std::optional<std::pair<double, double>> check; ///< bounds of the mean pose NEES
  bool plot = false;
  bool quiet = false;
  bool help = false;

  bool comparesRates() const { return !frame_rates.empty() || !imu_rates.empty(); }
};

/// What to study: the drive, or as many as there are pairs of rates.
std::vector<simulation::DriveOptions> drivesOf(const MonteCarloOptions& options);

/// Throws UsageError.
MonteCarloOptions parseMonteCarloOptions(int argc, const char* const* argv);

extern const char* const kMonteCarloHelp;

} // namespace vi_ekf_slam

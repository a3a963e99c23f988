#pragma once

#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam {

/// Writes seeds.csv, check_points.csv and frames.csv into `directory`, which must exist. Units: s, m, rad.
/// Throws std::runtime_error with file and cause.
void writeMonteCarlo(const std::string& directory, const std::vector<simulation::SeedResult>& results);

/// The table that a person reads.
std::string monteCarloSummary(const std::vector<simulation::SeedResult>& results);

/// A study at one pair of rates.
struct RateStudy {
  simulation::DriveOptions drive;
  std::vector<simulation::SeedResult> results;
};

/// The table that a person reads: a row a study.
std::string ratesSummary(const std::vector<RateStudy>& studies);

/// Writes rates.csv, a row a study, into `directory`, as writeMonteCarlo does.
void writeRates(const std::string& directory, const std::vector<RateStudy>& studies);

/// Whether the mean pose NEES is within `bounds` at every check point.
bool neesWithin(const std::vector<simulation::SeedResult>& results, const std::pair<double, double>& bounds);

} // namespace vi_ekf_slam

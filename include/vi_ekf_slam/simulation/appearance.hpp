#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// What points look like. Each has a random pattern of 256 bits, but for a share of them, which have one of
/// twenty. Bit j is turned over where a_j . (d, k log(r), 1) > 0, with d the direction from the camera to the
/// point, r their distance and a_j normal numbers: from one view to another as many bits change as these five
/// numbers turn (Goemans and Williamson 1995), 30 of them for 30 degrees and as many for twice the distance.
/// And in each observation some bits are anything.
class Appearance {
 public:
  explicit Appearance(const DriveOptions& options);

  /// `look` says which points look alike; `way` from the camera to the point, m, world axes.
  Descriptor describe(std::uint64_t look, const Eigen::Vector3d& way);

 private:
  std::uint64_t seed_;
  double alike_share_;
  Random random_;
  Eigen::Matrix<double, 256, 5> responses_; ///< row by row a_j
};

} // namespace vi_ekf_slam::simulation

#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Looks whether features are those of a rectified pair: in one row, and in front of the cameras. Judges the
/// first ones; check_rig.py says the same of a recording's pairs.
class PairCheck {
 public:
  /// Features as they come. `pixel_sigma`, px: of those that do not state theirs. Returns what is wrong, with
  /// figure, limit and what to do, once; else empty.
  std::string note(const StereoFrame& frame, double pixel_sigma);

 private:
  std::string judge() const;

  std::vector<double> rows_, sigmas_; ///< px
  std::size_t frames_ = 0, clear_ = 0, behind_ = 0;
  bool is_done_ = false;
};

} // namespace vi_ekf_slam

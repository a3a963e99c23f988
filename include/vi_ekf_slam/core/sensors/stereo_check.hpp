#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Looks whether features are those of a rectified pair: in one row, and in front of the cameras. Judges the
/// first ones, as they come, once; check_rig.py says the same of a recording. Nothing is dropped for it.
class StereoCheck {
 public:
  /// Features as they come, before any is dropped. `pixel_sigma`, px: of those that do not state theirs.
  /// Returns what is wrong, with figure, limit and what to do, the one time that it is found; else empty.
  std::string note(const StereoFrame& frame, double pixel_sigma);
  /// What is wrong; empty: nothing, or not known yet.
  const std::string& problem() const { return problem_; }

 private:
  std::string judge() const;

  std::vector<double> rows_, sigmas_; ///< px
  std::size_t frames_ = 0, clear_ = 0, behind_ = 0;
  bool judged_ = false;
  std::string problem_;
};

} // namespace vi_ekf_slam

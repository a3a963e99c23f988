#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Looks whether features are those of a rectified pair: in one row, and in front of the cameras; and whether
/// their ids follow points from frame to frame. Judges the first ones, as they come; check_rig.py says the
/// same of a recording's pairs. Nothing is dropped for it.
class StereoCheck {
 public:
  /// Features as they come, before any is dropped. `pixel_sigma`, px: of those that do not state theirs.
  /// Returns what is wrong, with figure, limit and what to do, once each; else empty.
  std::string note(const StereoFrame& frame, double pixel_sigma);
  /// What is wrong; empty: nothing, or not known yet.
  const std::string& problem() const { return problem_; }

 private:
  std::string notePair(const StereoFrame& frame, double pixel_sigma);
  std::string noteIds(const StereoFrame& frame);
  std::string judge() const;
  std::string idProblem() const;

  std::vector<double> rows_, sigmas_;                 ///< px
  std::map<std::uint64_t, Eigen::Vector2d> previous_; ///< px in the left picture of the frame before, by id
  // px from the frame before: of the same id against all others, and to the place of some other id.
  std::vector<double> moved_, apart_;
  std::size_t followable_ = 0; ///< features of frames that had one before them
  std::size_t frames_ = 0, clear_ = 0, behind_ = 0, id_frames_ = 0, id_windows_ = 0;
  bool judged_ = false;
  std::string problem_;
};

} // namespace vi_ekf_slam

#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Looks whether features are those of a rectified pair: in one row, and in front of the cameras. Judges the
/// first ones; check_rig.py says the same of a recording's pairs.
class PairCheck {
 public:
  /// As StereoCheck::note.
  std::string note(const StereoFrame& frame, double pixel_sigma);

 private:
  std::string judge() const;

  std::vector<double> rows_, sigmas_; ///< px
  std::size_t frames_ = 0, clear_ = 0, behind_ = 0;
  bool is_done_ = false;
};

/// Looks whether the ids of features follow points from frame to frame. Judges the first hundred frames.
class TrackIdCheck {
 public:
  /// As StereoCheck::note.
  std::string note(const StereoFrame& frame);

 private:
  std::string judge() const;

  std::map<FeatureId, Eigen::Vector2d> previous_; ///< px in the left picture of the frame before, by id
  // px from the frame before: of the same id against all others, and to the place of some other id.
  std::vector<double> moved_, apart_;
  std::size_t followable_ = 0; ///< features of frames that had one before them
  std::size_t frames_ = 0, windows_ = 0;
};

/// What the first features tell of pairs and of ids. Nothing is dropped for it.
class StereoCheck {
 public:
  /// Features as they come, before any is dropped. `pixel_sigma`, px: of those that do not state theirs.
  /// Returns what is wrong, with figure, limit and what to do, once each; else empty.
  std::string note(const StereoFrame& frame, double pixel_sigma);
  /// What is wrong; empty: nothing, or not known yet.
  const std::string& problem() const { return problem_; }

 private:
  PairCheck pair_;
  TrackIdCheck ids_;
  std::string problem_;
};

} // namespace vi_ekf_slam

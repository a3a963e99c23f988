#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Looks whether the ids of features follow points from frame to frame. Judges the first hundred frames.
class TrackIdCheck {
 public:
  /// Features as they come. Returns what is wrong, with figure, limit and what to do, once; else empty.
  std::string note(const StereoFrame& frame);

 private:
  std::string judge() const;

  std::map<std::uint64_t, Eigen::Vector2d> previous_; ///< px in the left picture of the frame before, by id
  // px from the frame before: of the same id against all others, and to the place of some other id.
  std::vector<double> moved_, apart_;
  std::size_t followable_ = 0; ///< features of frames that had one before them
  std::size_t frames_ = 0, windows_ = 0;
};

} // namespace vi_ekf_slam

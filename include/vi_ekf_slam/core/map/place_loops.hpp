#pragma once

#include <optional>

#include "vi_ekf_slam/core/map/landmark_map.hpp"

namespace vi_ekf_slam {

/// Closes loops where ids do not return: what was seen lately is compared by its constellation with what was
/// seen long ago in reach of the present uncertainty (recognisePlace). A match is told to the filter as two
/// points that are near each other; both remain.
class PlaceLoops {
 public:
  /// `seconds` have passed since the last frame. Whether a place was recognised.
  bool update(Filter& filter, LandmarkMap& map, Stamp now, double seconds);

 private:
  std::optional<Stamp> next_attempt_;
  double allowance_ = 0.0; ///< floating-point operations saved up for settling
};

} // namespace vi_ekf_slam

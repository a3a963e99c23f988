#pragma once

#include <optional>

#include "vi_ekf_slam/core/loops/fuse_matches.hpp"
#include "vi_ekf_slam/core/loops/place_recogniser.hpp"
#include "vi_ekf_slam/core/loops/settling.hpp"

namespace vi_ekf_slam {

/// Closes loops where ids do not return: what was seen lately is compared by its constellation with what was
/// seen long ago in reach of the present uncertainty (recognisePlace). What is recognised is believed when it
/// is again, from some metres farther on and by other points. A match is told to the filter as two points
/// that are near each other; both remain.
class PlaceLoops {
 public:
  PlaceLoops();
  /// After a frame. Landmarks of the place that was recognised.
  Revisit update(Filter& filter, LandmarkMap& map, Stamp now, Settling& settling);

  /// The world is another one.
  void restart() {
    agreement_.restart();
    confirmed_.clear();
  }

 private:
  Revisit close(Filter& filter, LandmarkMap& map);

  PlaceAgreement agreement_;
  Matches confirmed_; ///< waits until a loop may be closed
  std::optional<Stamp> next_attempt_;
};

} // namespace vi_ekf_slam

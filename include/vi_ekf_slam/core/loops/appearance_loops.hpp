#pragma once

#include <optional>

#include "vi_ekf_slam/core/loops/appearance_index.hpp"
#include "vi_ekf_slam/core/loops/fuse_matches.hpp"
#include "vi_ekf_slam/core/loops/place_recogniser.hpp"
#include "vi_ekf_slam/core/loops/settling.hpp"

namespace vi_ekf_slam {

/// Closes loops where ids do not return and landmarks have descriptors. A landmark in view is looked up among
/// those long out of view that the pose's covariance allows. Matches that fit one rigid motion are a place;
/// what several frames say, some way apart and by different landmarks, is fused, where the filter's own
/// covariance agrees. The landmarks that are expected then are recognised at first sight. The work of a frame
/// is bounded by counts, so that the result does not depend on timing.
class AppearanceLoops {
 public:
  AppearanceLoops();

  /// After a frame. Landmarks that were found to be ones that were seen before, by being compared.
  Revisit update(Filter& filter, LandmarkMap& map, Stamp now, Settling& settling);
  void restart();

 private:
  bool confirms(const Recognition& found, const Filter& filter, const LandmarkMap& map);
  void index(const Filter& filter, const LandmarkMap& map);
  std::optional<Recognition> recognise(const Filter& filter, const LandmarkMap& map) const;

  AppearanceIndex known_;
  std::optional<Stamp> next_index_, next_attempt_;
  LookUps look_ups_;
  PlaceAgreement agreement_;
};

} // namespace vi_ekf_slam

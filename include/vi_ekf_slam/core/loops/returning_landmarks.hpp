#pragma once

#include <unordered_set>
#include <vector>

#include "vi_ekf_slam/core/loops/fuse_matches.hpp"
#include "vi_ekf_slam/core/loops/settling.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"

namespace vi_ekf_slam {

/// After a frame: where landmarks of the map are in view, those before the camera that have been out of view
/// for some time are expected from now on, the nearest ones. Once a second.
void lookAhead(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now, Settling& settling);

/// Before a frame is associated: features of new tracks that look like landmarks which are expected in view,
/// and lie where these should be seen, are theirs from now on, to kCornerSigma. Where the present view does
/// not tell that place well, or nothing tracked is seen, only three that agree are believed: the tracks of a
/// new view agree with whatever moves the pose.
void claimExpected(Filter& filter, LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
                   const std::vector<std::size_t>& usable);

/// Closes loops where ids return. Such a landmark begins as a new one. When some have been seen often enough
/// they are fused with what was seen of them before. Those that are expected are recognised at first sight.
class ReturningLandmarks {
 public:
  /// After a frame. Those that were fused.
  Revisit update(Filter& filter, LandmarkMap& map, Stamp now, Settling& settling);

  /// Fuses the active landmarks of these ids with the inactive ones, where `least` of them agree.
  Revisit fuse(Filter& filter, LandmarkMap& map, const std::vector<FeatureId>& ids, std::size_t least);

  /// Before a frame is associated: landmarks that are expected, and whose ids are in it, become active.
  static void recognise(Filter& filter, LandmarkMap& map, const StereoFrame& frame,
                        const std::vector<std::size_t>& usable);

  void restart() { elsewhere_.clear(); }

 private:
  std::unordered_set<FeatureId> elsewhere_; ///< in view, and not where they were seen before
};

} // namespace vi_ekf_slam

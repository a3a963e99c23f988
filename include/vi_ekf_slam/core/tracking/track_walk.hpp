#pragma once

#include <vector>

#include "vi_ekf_slam/core/tracking/frame_update.hpp"

namespace vi_ekf_slam {

/// The tracks that are seen again have slid over what they show for `seconds`, each for itself, as their
/// features state (StereoFeatureObservation::walk): the points that they stand for are where they are now.
/// What a track strays stays in all its later observations, which independent noise cannot say.
void letTracksWalk(Filter& filter, const LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
                   const std::vector<Association>& seen, double seconds);

} // namespace vi_ekf_slam

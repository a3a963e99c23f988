#pragma once

#include <vector>

#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"

namespace vi_ekf_slam {

/// Before a frame is associated: features of new tracks that look like landmarks which are expected in view,
/// and lie where these should be seen, are theirs from now on, to kCornerSigma. Where the present view does
/// not tell that place well, or nothing tracked is seen, only three that agree are believed: the tracks of a
/// new view agree with whatever moves the pose.
void claimExpected(Filter& filter, LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
                   const std::vector<std::size_t>& usable);

} // namespace vi_ekf_slam

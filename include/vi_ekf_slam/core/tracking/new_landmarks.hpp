#pragma once

#include <cstddef>
#include <vector>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Which of a frame's features (by number) become landmarks, so that at most `most` of the map's are in view.
/// Those nearest to the middle of the picture first, which stay longest; but before any other those that keep
/// clear of what is chosen already, since near neighbours tell much the same.
std::vector<std::size_t> chooseNewLandmarks(const StereoFrame& frame, const StereoCamera& camera,
                                            const LandmarkMap& map, std::vector<std::size_t> features,
                                            std::size_t most);

} // namespace vi_ekf_slam

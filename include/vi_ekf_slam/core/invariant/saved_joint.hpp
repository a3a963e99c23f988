#pragma once

#include "vi_ekf_slam/core/invariant/state.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"

namespace vi_ekf_slam::invariant {

/// What State takes back of a saved map, less certain by what the rounding of the largest variance comes to,
/// so that corrections leave every variance positive.
State::Joint jointOf(const SavedMap& map);

} // namespace vi_ekf_slam::invariant

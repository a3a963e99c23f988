#pragma once

#include <functional>

#include "vi_ekf_slam/core/tracking/frame_update.hpp"

namespace vi_ekf_slam {

/// Where next to nothing is known of the twist (a camera alone that begins in motion), a frame's prediction
/// is metres off, and its correction far from linear. Iterated Kalman filter: `filter`, of the frame before,
/// is to be predicted (`ahead`, by `seconds`) with the twist that the frame itself tells; what is known
/// beforehand stays.
void guessTwist(Filter& filter, const FrameUpdate& update, const LandmarkMap& map, const StereoFrame& frame,
                double seconds, const std::function<void(Filter&)>& ahead);

} // namespace vi_ekf_slam

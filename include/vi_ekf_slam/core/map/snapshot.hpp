#pragma once

#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"
#include "vi_ekf_slam/core/motion/motion_model.hpp"

namespace vi_ekf_slam {

/// All that a filter and its landmarks know at `stamp`. Both are copies, which change.
SavedMap snapshotOf(Filter filter, LandmarkMap landmarks, const MotionModel& motion, Stamp stamp);

/// Puts what was saved into a filter and a map that have nothing but a core. What was in view is inactive now,
/// like the rest: tracks that go on begin as new landmarks and are fused with it.
void restore(const SavedMap& map, Filter& filter, LandmarkMap& landmarks, const MotionModel& motion);

} // namespace vi_ekf_slam

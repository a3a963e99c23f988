#pragma once

#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"
#include "vi_ekf_slam/core/motion/motion_model.hpp"

namespace vi_ekf_slam {

/// All that a filter's named variables and its landmarks know at `stamp`. Both are copies, which change.
SavedMap snapshotOf(Filter filter, LandmarkMap landmarks, Stamp stamp);

/// Puts what was saved into a filter and a map that have nothing but a core. Variables are known by name and
/// size: what the filter does not have is marginalised, what the map does not have stays as it is. What was
/// in view is inactive now, like the rest: tracks that go on begin as new landmarks and are fused with it.
void restore(const SavedMap& map, Filter& filter, LandmarkMap& landmarks);

/// Throws MapError, in the name of `source`, unless the map has all of the motion's variables that are in the
/// filter: a drive cannot go on without them.
void requireMotion(const SavedMap& map, const Filter& filter, const MotionModel& motion,
                   const std::string& source);

} // namespace vi_ekf_slam

#pragma once

#include <optional>

#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/map/saved_map.hpp"
#include "vi_ekf_slam/core/motion/motion_model.hpp"

namespace vi_ekf_slam {

/// All that a filter's named variables and its landmarks know at `stamp`. Both are copies, which change. The
/// variables correct `given`.
SavedMap snapshotOf(Filter filter, LandmarkMap landmarks, Stamp stamp,
                    const std::optional<StereoRig>& given = {});

/// A saved map's covariance, a little larger than what rounding may make of it beside the errors of `pose`,
/// which the vehicle has when the map becomes its own.
Eigen::MatrixXd loadedCovariance(const SavedMap& map, const Matrix6d& pose);

/// Puts what was saved into a filter and a map that have nothing but a core. Variables are known by name and
/// size: what the filter does not have is marginalised, what the map does not have stays as it is. What was
/// in view is inactive now, like the rest: tracks that go on begin as new landmarks and are fused with it.
/// Corrections of another rig than `given`, or of one that is not known, stay as they are too.
void restore(const SavedMap& map, Filter& filter, LandmarkMap& landmarks,
             const std::optional<StereoRig>& given = {});
/// False where the map has such corrections.
bool correctsRig(const SavedMap& map, const std::optional<StereoRig>& given);

/// Throws MapError, in the name of `source`, unless the map has all of the motion's variables that are in the
/// filter: a drive cannot go on without them.
void requireMotion(const SavedMap& map, const Filter& filter, const MotionModel& motion,
                   const std::string& source);

} // namespace vi_ekf_slam

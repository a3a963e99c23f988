#pragma once

#include <string>

#include "vi_ekf_slam/SetState.h"
#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/ros/output/base_frame.hpp"

namespace vi_ekf_slam {

/// Reads a state of the IMU in `map_frame` into one in the estimator's world, `base` of a world whose z axis
/// points up. What is wrong with the request, and what is allowed; empty: nothing, and `state` is set.
std::string readToldState(const SetState::Request& request, const std::string& map_frame,
                          const BaseFrame& base, InitialState& state);

} // namespace vi_ekf_slam

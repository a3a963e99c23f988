#pragma once

#include "vi_ekf_slam/core/filter/filter.hpp"

namespace vi_ekf_slam {

/// The body is at pose * motion, its pose less certain by `covariance` (6x6 of dp, theta); all else stays.
void resetPose(Filter& filter, const SE3& motion, const Matrix6d& covariance);

/// The body is said to be at `pose`, known to `covariance` (6x6 of dp, theta), and was anywhere before. Of a
/// filter that is level the tilt stays. False, and the filter is not to be used, where it is not valid then.
bool tellPose(Filter& filter, const SE3& pose, const Matrix6d& covariance);

} // namespace vi_ekf_slam

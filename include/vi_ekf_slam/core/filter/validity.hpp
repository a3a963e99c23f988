#pragma once

#include "vi_ekf_slam/core/filter/filter.hpp"

namespace vi_ekf_slam {

/// Whether all means and variances of the filter's core are finite, no variance is negative, and,
/// `thoroughly`, its covariance is positive semidefinite.
bool isValid(const Filter& filter, bool thoroughly);

} // namespace vi_ekf_slam

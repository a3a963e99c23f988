#pragma once

#include "vi_ekf_slam/core/filter/filter.hpp"

namespace vi_ekf_slam {

/// Whether all means and variances of the filter's core are finite and no variance is negative; `thoroughly`,
/// whether its covariance is positive semidefinite and every other variance is one too.
bool isValid(const Filter& filter, bool thoroughly);

} // namespace vi_ekf_slam

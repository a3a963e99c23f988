#pragma once

#include "vi_ekf_slam/core/filter/filter.hpp"

namespace vi_ekf_slam {

/// What a sensor of the body's twist says: `measured` = (three axes of the twist, from `axis` on: 0 velocity
/// in m/s, 3 angular velocity in rad/s) + bias + noise (3x3), in the body's axes.
LinearMeasurement measureTwist(const Filter& filter, Handle twist, Handle bias, Eigen::Index axis,
                               const Eigen::Vector3d& measured, const Eigen::Matrix3d& noise);

/// Corrects the filter's core by a velocity. One that contradicts it (wheels that slip or are blocked) hardly
/// counts; false then.
bool correctByVelocity(Filter& filter, const LinearMeasurement& velocity);

/// How far the twist of a body that stands still for `dt` s may be from zero: 6x6 of (m/s, rad/s).
Matrix6d standstillNoise(double dt);

/// The body has stood still for `dt` s: its twist is zero, but for what a running engine shakes it.
LinearMeasurement measureStandstill(const Filter& filter, Handle twist, double dt);

} // namespace vi_ekf_slam

#pragma once

#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_study.hpp"
#include "vi_ekf_slam/simulation/monte_carlo.hpp"

namespace vi_ekf_slam::simulation {

/// `config` for a filter that is told what is true of the drive: the inertial model of motion, the densities
/// of the IMU and how large its first biases may be, the noise of the pixels, gravity, and that tracks do not
/// slip.
Config toldTheTruth(Config config, const DriveOptions& options);

/// The truth with errors of the covariance that is stated, the same for the same seed: standard deviations of
/// 1e-4 m and, about the vertical, rad, of 1e-3 rad of tilt, 1e-2 m/s, 1e-3 rad/s and 1e-2 m/s^2.
InitialState drawnStart(const TrueState& truth, std::uint64_t seed);

/// The world in which the truth is, in the map of an estimate that knows neither its place nor its heading
/// there: such that `truth` has no error of position and none about the map's z axis.
SE3 mapOfTruth(const SE3& truth, const SE3& estimate);

/// runSeed of a drive with a raw IMU: through SlamSystem, told the truth. Throws std::invalid_argument for
/// the paper's filter.
SeedResult runInertialSeed(const Config& config, const DriveOptions& options, const InertialStudy& study);

} // namespace vi_ekf_slam::simulation

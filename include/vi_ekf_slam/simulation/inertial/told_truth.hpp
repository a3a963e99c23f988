#pragma once

#include <array>
#include <cstdint>

#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/core/observation/rig_variables.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"
#include "vi_ekf_slam/simulation/drive_simulator.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_study.hpp"

/// What an estimator of a drive with a raw IMU is told of the truth.
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

/// The rig that an estimator is told, which is not the true one.
class ToldRig {
 public:
  ToldRig(std::uint64_t seed, const StereoRig& truth, const RigDisturbance& disturbance);

  const StereoRig& told() const { return told_; }
  /// s, of the IMU's clock ahead of the pictures' stamps, which the estimator is told to be 0.
  double timeOffset() const { return time_offset_; }
  /// What is left of the errors in an estimate of the rig.
  std::array<InertialOutcome::RigPart, 8> judge(const RigEstimate& estimate) const;

 private:
  StereoRig truth_, told_;
  double time_offset_ = 0.0;
};

} // namespace vi_ekf_slam::simulation

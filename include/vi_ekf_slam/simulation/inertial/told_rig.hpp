#pragma once

#include <array>
#include <cstdint>

#include "vi_ekf_slam/core/observation/rig_variables.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_study.hpp"

namespace vi_ekf_slam::simulation {

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

#pragma once

#include <string>

#include "vi_ekf_slam/core/observation/rig_variables.hpp"

namespace vi_ekf_slam {

/// A rig's calibration as YAML: what a run estimated, for `calibration/file` of the next one's configuration.
std::string rigCalibrationText(const RigEstimate& estimate);

/// Reads such a file; of the camera it has the baseline alone. Throws ConfigError.
RigEstimate readRigCalibration(const std::string& path);

} // namespace vi_ekf_slam

#pragma once

#include <Eigen/Core>
#include <stdexcept>
#include <string>

#include "vi_ekf_slam/core/sensors/measurement_buffer.hpp"
#include "vi_ekf_slam/core/slam/invariant_config.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// A configuration that cannot be used. what() names the file, the key, the value and what is allowed.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class EstimatorType { kPaper, kInvariant };

enum class PaperMode {
  kDeadReckoning, ///< EKF prediction alone (paper section III-B)
  kMapping,       ///< landmark EKF along the dead-reckoned trajectory (eq. 13 to 17)
  kSlam,          ///< joint EKF over landmarks and pose (eq. 9 to 20)
};

/// The paper's filter; defaults are the values of its section IV-C.
struct PaperConfig {
  PaperMode mode = PaperMode::kSlam;
  Vector6d motion_noise = Vector6d::Constant(1e-4); ///< diagonal of W, m^2 and rad^2 per step
  double step_s = 0.1;      ///< s, the step that W is meant for; W grows in proportion to the actual one
  double pixel_noise = 5e9; ///< V, px^2
  double prior_pose_variance = 0.01;      ///< Sigma_IMU, m^2 and rad^2
  double prior_landmark_variance = 300.0; ///< Sigma_Landmark, m^2
  double landmark_fraction = 0.1;         ///< of all ids, spread evenly over them; in (0, 1]
  double min_depth_m = 0.5;               ///< m; nearer points are not used
  double max_depth_m = 1000.0;            ///< m; points that start farther away are not used
};

struct Config {
  EstimatorType estimator = EstimatorType::kInvariant;
  MeasurementBuffer::Options buffer;
  /// s of sensor time that measurements wait for the calibration at the start: camera_info and /tf_static
  /// come within a second where they come at all, and the buffer must not grow without end.
  double rig_wait_s = 2.0;
  InvariantConfig invariant;
  PaperConfig paper;
};

} // namespace vi_ekf_slam

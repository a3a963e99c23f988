#pragma once

#include <cstddef>

#include "vi_ekf_slam/core/health/divergence_monitor.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

enum class MapKeep {
  kNone, ///< landmarks out of view are marginalised; their last estimates stay in the map
  kGood, ///< those with enough observations stay in the joint covariance
  kAll,  ///< all of them do
};

/// What becomes of landmarks out of view.
struct MapConfig {
  MapKeep keep = MapKeep::kGood;
  std::size_t min_observations = 10; ///< of a landmark, to be a good one
  /// Out of view in the joint covariance; beyond it those longest out of view are marginalised, and their
  /// last estimates stay in the map.
  std::size_t max_landmarks = 2000;
  std::size_t deferred_mb = 256; ///< MiB that deferred steps may take until they are composed
  /// Whether places are recognised by the constellation of their landmarks, where ids do not return.
  bool recognise_places = false;
};

/// The right-invariant EKF. Vectors are (velocity x, y, z, angular velocity x, y, z) in the IMU frame; sigmas
/// are standard deviations.
struct InvariantConfig {
  /// Root spectral density of the twist's derivative, m/s^1.5 and rad/s^1.5: how hard the body can
  /// accelerate.
  Vector6d twist_density = (Vector6d() << 0.5, 0.08, 0.08, 0.05, 0.05, 0.05).finished();
  /// Root spectral density of the biases' random walk, m/s^1.5 and rad/s^1.5.
  Vector6d bias_density = Vector6d::Zero();
  Vector6d prior_twist_sigma = (Vector6d() << 15.0, 1.0, 1.0, 0.3, 0.3, 0.5).finished();
  /// Of sensors with the two noises below; a sensor whose messages state less noise is given less, in
  /// proportion to the square.
  Vector6d prior_bias_sigma = (Vector6d() << 1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01).finished();
  double velocity_sigma = 0.5; ///< m/s per axis, of samples without a covariance
  double gyro_sigma = 0.05;    ///< rad/s per axis, of samples without a covariance
  bool twist_state = true; ///< false: the measured twist is taken as it is, sample by sample (for comparison)

  double pixel_sigma = 1.15;   ///< px, of each of the four pixel coordinates
  double min_disparity = 1.0;  ///< px; features with less are not used
  double max_row_offset = 4.0; ///< px between v_left and v_right; features with more are not used
  double min_depth_m = 0.5;    ///< m
  double max_depth_m = 150.0;  ///< m; points that start farther away do not become landmarks

  bool consensus = true;     ///< 1-point RANSAC inside the filter (for comparison: false)
  double consensus_px = 1.2; ///< px, RMS residual of the four coordinates up to which a feature agrees
  double gate = 7.815;       ///< chi-square limit with 3 degrees of freedom for a single feature (95 %)
  double frame_gate = 5.0;   ///< NIS per degree of freedom beyond which a whole frame is impossible
  /// Chi-square limit with 3 degrees of freedom for a feature to take part in the consensus at all.
  double plausible_gate = 30.0;
  /// Limit of the twist's correction by a frame, squared and in units of its prior covariance (6 degrees of
  /// freedom), beyond which the frame is impossible.
  double motion_gate = 60.0;

  /// Root spectral density of the twist's derivative in a bump, on top of twist_density: tried where less
  /// than `manoeuvre_share` of a frame agrees with the prediction, and believed where that much agrees then.
  /// All 0: never.
  Vector6d manoeuvre_density = (Vector6d() << 0.2, 0.2, 0.2, 0.3, 0.3, 0.3).finished();
  double manoeuvre_share = 0.6;

  /// What the model leaves out, as it is in the covariances published: random walk of the whole estimate
  /// about the vehicle, over the distance driven, m/m^0.5 and rad/m^0.5.
  double drift_position = 0.01;
  double drift_rotation = 0.0015;

  /// Median motion of the tracks from frame to frame up to which the picture stands still, px; 0: standstill
  /// is not looked for.
  double standstill_px = 0.3;

  /// Standard deviation of the error of scale in what the pair sees (baseline, lagging tracks), before
  /// anything was compared with the measured velocity; 0: the scale is taken as right.
  double scale_sigma = 0.03;
  double scale_significance = 3.5; ///< sigmas beyond which an error of scale is proven, and corrected

  DivergenceMonitor::Options divergence;
  /// By which the static world is displaced from one frame to the next, beyond what the vehicle drives, m; 0:
  /// not looked for.
  double divergence_jump_m = 10.0;

  MapConfig map;
};

} // namespace vi_ekf_slam

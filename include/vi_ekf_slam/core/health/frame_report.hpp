#pragma once

#include <cstddef>

#include "vi_ekf_slam/core/health/divergence_monitor.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// What an estimator did with one stereo frame.
struct FrameReport {
  FrameReport() = default;
  explicit FrameReport(const StereoFrame& frame) : stamp(frame.stamp), features(frame.features.size()) {}

  Stamp stamp = 0;
  std::size_t features = 0; ///< in the frame
  std::size_t invalid = 0; ///< not usable in themselves: not finite, no positive disparity, outside the range
  std::size_t used = 0;    ///< corrected the state
  std::size_t rejected = 0;      ///< contradicted the state (gate, consensus)
  std::size_t rejected_now = 0;  ///< of these, those that did so in this frame, not before
  std::size_t initialised = 0;   ///< became landmarks
  std::size_t removed = 0;       ///< landmarks that are no longer active
  std::size_t revisited = 0;     ///< landmarks found to be ones that were seen before
  bool place_recognised = false; ///< without ids, by what landmarks look like or their constellation
  bool relocalised = false;      ///< from this frame on all poses and landmarks are in the loaded map's frame
  std::size_t landmarks = 0;     ///< in the state after the frame, active
  std::size_t inactive = 0;      ///< landmarks out of view that are in the joint covariance after the frame
  std::size_t contradicting_velocities = 0; ///< samples since the frame before that contradicted the state
  bool frame_rejected = false;              ///< the frame as a whole was found impossible and not used
  /// Normalised innovation squared and its degrees of freedom, by which the innovation covariances can be
  /// judged: the mean of their ratio is 1. 0 where nothing was used.
  double nis = 0.0;
  std::size_t nis_dof = 0;
  /// The estimate was no longer believed, for this reason, and begun anew from where it was: without
  /// landmarks, and with a covariance that covers what may have gone wrong.
  Divergence divergence = Divergence::kNone;
};

} // namespace vi_ekf_slam

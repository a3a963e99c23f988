#pragma once

#include "vi_ekf_slam/core/health/recovery.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/motion/constant_twist.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"
#include "vi_ekf_slam/core/observation/track_slip.hpp"
#include "vi_ekf_slam/core/tracking/frame_update.hpp"

namespace vi_ekf_slam {

/// Limits of what is used of a frame that may be changed while it runs, see FrameUpdate::Options.
struct Gates {
  double gate, frame_gate;
};

/// The right-invariant EKF, room by room.
struct InvariantConfig {
  Gates gates() const { return {update.gate, update.frame_gate}; }
  void setGates(const Gates& gates) {
    update.gate = gates.gate;
    update.frame_gate = gates.frame_gate;
  }

  ConstantTwist::Options motion;
  StereoModel::Options stereo;
  TrackSlip::Options slip;
  FrameUpdate::Options update;
  Recovery::Options recovery;
  LandmarkMap::Options map;
  /// Standard deviation of the relative error of the baseline beforehand; 0: the baseline is known.
  double scale_sigma = 0.0;
  /// Median motion of the tracks in a tenth of a second up to which the picture stands still, px; 0: never.
  double standstill_px = 0.3;
  /// Whether places are recognised by the constellation of their landmarks, where ids do not return.
  bool recognise_places = false;
};

} // namespace vi_ekf_slam

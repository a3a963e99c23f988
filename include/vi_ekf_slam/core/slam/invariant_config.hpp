#pragma once

#include <optional>

#include "vi_ekf_slam/core/health/recovery.hpp"
#include "vi_ekf_slam/core/loops/place_recogniser.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"
#include "vi_ekf_slam/core/motion/constant_twist.hpp"
#include "vi_ekf_slam/core/motion/inertial.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"
#include "vi_ekf_slam/core/tracking/frame_update.hpp"
#include "vi_ekf_slam/core/tracking/track_slip.hpp"

namespace vi_ekf_slam {

/// Limits of what is used of a frame that may be changed while it runs, see FrameUpdate::Options.
struct Gates {
  double gate, frame_gate;
};

/// How the body is taken to move.
enum class MotionChoice {
  kAuto, ///< inertial where the IMU's messages carry accelerations, at 50 Hz or more, else constant twist
  kConstantTwist, ///< gyro and velocity are measurements of a slowly changing twist
  kInertial,      ///< gyro and accelerometer are inputs
};

/// The right-invariant EKF, room by room.
struct InvariantConfig {
  Gates gates() const { return {update.gate, update.frame_gate}; }
  void setGates(const Gates& gates) {
    update.gate = gates.gate;
    update.frame_gate = gates.frame_gate;
  }

  MotionChoice choice =
      MotionChoice::kAuto; ///< kAuto is a constant twist to whom makes an estimator by itself
  ConstantTwist::Options motion;
  Inertial::Options inertial;
  StereoModel::Options stereo;
  TrackSlip::Options slip;
  FrameUpdate::Options update;
  Recovery::Options recovery;
  LandmarkMap::Options map;
  RigVariables::Options rig;
  /// Median motion of the tracks in a tenth of a second up to which the picture stands still, px; 0: never.
  double standstill_px = 0.3;
  /// Landmarks in view at a time, half as many more while the place in a loaded map is looked for: the time
  /// for a frame grows with their cube.
  std::size_t max_tracked = 80;
  PlaceRecognition recognise_places = PlaceRecognition::kDescriptors;

  /// What is known already when an estimator is made, and told to it: see Estimator::setRig, setBiasPrior.
  std::optional<StereoRig> told_rig{};
  std::optional<TwistBias> told_bias{};
};

} // namespace vi_ekf_slam

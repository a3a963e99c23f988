#pragma once

#include <array>
#include <limits>

namespace vi_ekf_slam::simulation {

/// How an estimator of a drive with a raw IMU begins.
enum class StudyStart {
  kGiven, ///< at the first sample, from the truth with errors drawn from the covariance that it is given
  kSelf,  ///< by itself
};

/// By how much the rig that the estimator is told differs from the true one, in a direction drawn by the
/// seed.
struct RigDisturbance {
  double rotation = 0.0;    ///< rad, of the transform from the IMU to the camera
  double translation = 0.0; ///< m, of the same
  double time_offset = 0.0; ///< s, of the pictures' stamps
  double scale = 0.0;       ///< 1, of the baseline
  bool isNone() const { return rotation == 0.0 && translation == 0.0 && time_offset == 0.0 && scale == 0.0; }
};

/// What a study of drives with a raw IMU asks beside the drive.
struct InertialStudy {
  StudyStart start = StudyStart::kGiven;
  double blind_from = 0.0; ///< s after the first frame, from where on frames come without features
  double blind_for = 0.0;  ///< s; 0: never
  RigDisturbance disturbance;
};

/// Of a drive with a raw IMU alone; not a number: it never came to that.
struct InertialOutcome {
  static constexpr double kNever = std::numeric_limits<double>::quiet_NaN();
  double start_delay = kNever; ///< s from the first frame to the first one with an estimate
  // NEES of the first estimate.
  double first_pose = kNever; ///< 6 degrees of freedom; 2 of a start by itself, in whose map the truth is put
  double first_tilt = kNever; ///< 2
  double first_velocity = kNever; ///< 3, IMU axes
  // Of the last frame without features.
  double blind_nees = kNever;     ///< of the position, 3
  double blind_position = kNever; ///< m, error
  /// Of a disturbed rig, part by part (x, y, z of the rotation in rad and of the translation in m, the time
  /// offset in s, the scale): its error before, at the end, and the standard deviation that is stated then.
  struct RigPart {
    double before = kNever, after = kNever, sigma = kNever;
  };
  std::array<RigPart, 8> rig;
};

} // namespace vi_ekf_slam::simulation

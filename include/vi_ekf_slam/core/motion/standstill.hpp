#pragma once

#include <deque>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// Tells from the last second of measurements whether the body stands still. The velocity and the gyro must
/// agree with zero, as the mean over the window; and the picture must stand still, or, where there is none,
/// the velocity must be good enough to tell by itself. A car ahead that stands or moves with us cannot do it
/// alone, nor can a slow creep below a bad odometer's noise.
class StandstillDetector {
 public:
  /// still_px: largest median motion of the tracks in a tenth of a second, px. Without `needs_velocity` gyro
  /// and picture suffice, where there are no samples of the velocity.
  explicit StandstillDetector(double still_px, bool needs_velocity = true)
      : still_px_(still_px), needs_velocity_(needs_velocity) {}

  /// A sample without its estimated bias; `covariance` 3x3 of its white noise.
  void addVelocity(Stamp stamp, const Eigen::Vector3d& velocity, const Eigen::Matrix3d& covariance);
  /// `bias_covariance`: 3x3 of what is not known of the bias that was taken off.
  void addGyro(Stamp stamp, const Eigen::Vector3d& rate, const Eigen::Matrix3d& covariance,
               const Eigen::Matrix3d& bias_covariance);
  void addFrame(const StereoFrame& frame);

  /// Whether the body stands still at `now`.
  bool stands(Stamp now) const;

 private:
  struct Sample {
    Stamp stamp;
    Eigen::Vector3d value;
    Eigen::Vector3d variance; ///< of the white noise
  };
  struct Mean {
    Eigen::Vector3d value = Eigen::Vector3d::Zero();
    Eigen::Vector3d variance = Eigen::Vector3d::Zero(); ///< of the mean
  };
  struct Flow {
    Stamp stamp;
    double median; ///< px
  };
  enum class Picture { kStill, kMoving, kUnknown };

  static bool coversWindow(const std::deque<Sample>& samples, Stamp now);
  static bool agreesWithZero(const std::deque<Sample>& samples, const Eigen::Vector3d& bias_variance);
  static Mean meanOf(const std::deque<Sample>& samples);
  Picture picture(Stamp now) const;

  double still_px_;
  bool needs_velocity_;
  std::deque<Sample> velocities_, rates_;
  Eigen::Vector3d bias_variance_ = Eigen::Vector3d::Zero(); ///< of the gyro
  std::deque<Flow> flows_;                     ///< of frames that share enough tracks with the one before
  std::vector<StereoFeatureObservation> last_; ///< by id
  Stamp last_stamp_ = 0;
};

} // namespace vi_ekf_slam

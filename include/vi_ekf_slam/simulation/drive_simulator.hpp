#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/front_end.hpp"
#include "vi_ekf_slam/simulation/inertial/inertial_sensor.hpp"
#include "vi_ekf_slam/simulation/motion.hpp"
#include "vi_ekf_slam/simulation/scene.hpp"
#include "vi_ekf_slam/simulation/traffic.hpp"

namespace vi_ekf_slam::simulation {

/// All that an inertial filter estimates of the body.
struct TrueState {
  Stamp stamp = 0;
  SE3 world_T_imu;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();           ///< m/s, world axes
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();          ///< rad/s, of the last sample
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero(); ///< m/s^2, of the last sample
};

/// One frame and the samples from its stamp (included) to the next frame's (excluded), which may be none.
///
/// Sample j is nu_j + bias + noise with the covariance of the noise attached (none where the noise is 0).
/// nu_j is the true twist at t_j. The car holds it until the next sample: T_{j+1} = T_j Exp((t_{j+1} - t_j)
/// nu_j), so noise-free samples dead-reckon to the car's true poses exactly, when each is held until the
/// next. In the process model the twist goes on changing within the step (see ProcessMotion).
///
/// A raw IMU (DriveOptions::hasRawImu) is described by InertialSensor, and its samples do not coincide with
/// frames. Its first sample comes before the first frame and belongs to that frame's step. `velocity` is
/// empty unless it is asked for.
struct DriveStep {
  std::size_t index = 0;
  Stamp stamp = 0;
  /// At `stamp`. The identity in the first step; with a raw IMU z points up instead.
  SE3 world_T_imu;
  std::vector<Vector6d> true_twist; ///< at the samples: (v in m/s, omega in rad/s), IMU frame
  std::vector<ImuSample> gyro;
  std::vector<VelocitySample> velocity;
  StereoFrame frame;
  std::vector<ObservationTruth> truth; ///< of frame.features, in their order
  bool stale = false;
};

/// Produces a drive step by step, in memory that does not grow with its length. A seed always gives the same
/// drive.
class DriveSimulator {
 public:
  /// Throws std::invalid_argument as checkDriveOptions does.
  explicit DriveSimulator(const DriveOptions& options);

  /// The next step; nothing when the drive is over.
  std::optional<DriveStep> next();

  /// Fraction of the drive that is done, from 0 to 1.
  double progress() const;

  const StereoRig& rig() const { return view_.rig; }
  const DriveOptions& options() const { return options_; }
  /// With a raw IMU, before the first step: at the stamp of its first sample.
  std::optional<TrueState> state() const { return stateAt(now_); }
  /// The same at any stamp, with the biases of now.
  std::optional<TrueState> stateAt(Stamp stamp) const;
  const Eigen::Vector3d& gyroBias() const { return gyro_bias_; }         ///< rad/s, the first
  const Eigen::Vector3d& velocityBias() const { return velocity_bias_; } ///< m/s

 private:
  void drawBiases();
  Stamp stampOf(std::size_t index, double rate, double offset = 0.0) const;
  Stamp frameStamp(std::size_t index) const;
  void takeSamplesBefore(Stamp stamp, DriveStep& step);
  void moveTo(Stamp stamp);
  void takeSample(DriveStep& step);

  DriveOptions options_;
  View view_;
  std::unique_ptr<Motion> motion_;
  std::unique_ptr<Scene> scene_;
  Traffic traffic_;
  FrontEnd front_end_;
  Random imu_random_;
  std::optional<InertialSensor> raw_imu_;
  Eigen::Vector3d gyro_bias_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_bias_ = Eigen::Vector3d::Zero();
  Stamp now_;                         ///< where motion and traffic have got to
  Vector6d twist_ = Vector6d::Zero(); ///< of the last sample
  std::size_t index_ = 0;             ///< of the next frame
  std::size_t samples_ = 0;           ///< so far
};

/// A whole drive.
struct Drive {
  DriveOptions options;
  StereoRig rig;
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();     ///< rad/s
  Eigen::Vector3d velocity_bias = Eigen::Vector3d::Zero(); ///< m/s
  std::vector<DriveStep> steps;
};

Drive simulateDrive(const DriveOptions& options);

/// The measurements of a step in the order in which an estimator takes them: by stamp, then gyro, velocity,
/// frame.
std::vector<Measurement> measurementsOf(const DriveStep& step);

} // namespace vi_ekf_slam::simulation

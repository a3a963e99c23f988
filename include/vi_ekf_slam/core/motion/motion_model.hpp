#pragma once

#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/sensors/imu_track.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

struct InitialState;

/// Noise (3x3) of one sample of the body's velocity and of the gyro, where there are samples.
struct TwistNoise {
  std::optional<Eigen::Matrix3d> velocity, gyro;
};

/// How a body moves between two stamps, and what its own sensors say about that: the variables of the
/// filter's core beside the pose, how all of them propagate, and what a sample corrects.
class MotionModel {
 public:
  virtual ~MotionModel() = default;

  /// Adds its variables to a filter that has nothing but the pose.
  virtual void addTo(Filter& filter) = 0;
  /// Their names: what must be known of a drive to go on from there.
  virtual std::vector<std::string> variables() const = 0;
  /// Goes on from this state, before anything is added to the filter's core; false where it has no use for
  /// it.
  virtual bool begin(Filter& /*filter*/, const InitialState& /*state*/) const { return false; }
  /// Whether it needs samples of the velocity to tell that the body stands still.
  virtual bool measuresVelocity() const { return true; }
  /// What is known of the biases beforehand, in place of the configured prior: from now on, what
  /// was learned is forgotten, and after every reset.
  virtual void setBiasPrior(Filter& filter, const TwistBias& bias) = 0;
  /// Before the variables are added: the body's axes are a camera's (x right, y down, z ahead), not a
  /// vehicle's (x ahead, y left, z up), in which the options are.
  virtual void setOpticalBody() {}
  /// Pose of a body of which nothing is known: the world has a vehicle's axes.
  virtual SE3 startPose() const { return {}; }
  /// Moves on from one stamp to the next, between which the IMU has no other sample.
  virtual void propagate(Filter& filter, const ImuTrack& imu, Stamp from, Stamp to) const = 0;
  virtual void process(Filter& filter, const ImuSample& sample) const = 0;
  virtual LinearMeasurement measure(const Filter& filter, const VelocitySample& sample) const = 0;
  /// 3x3 of a sample's white noise: its own covariance, or the configured one.
  virtual Eigen::Matrix3d noiseOf(const ImuSample& sample, const ImuTrack& imu) const = 0;
  virtual Eigen::Matrix3d noiseOf(const VelocitySample& sample) const = 0;
  /// The body has stood still for `dt` s.
  virtual void processStandstill(Filter& filter, const ImuTrack& imu, Stamp now, double dt) const = 0;
  /// Whether the state allows for it.
  virtual bool mayStand(const Filter& /*filter*/) const { return true; }
  /// What moves is unknown again, and with `biases` those as well. What has been `sampled` is as uncertain as
  /// one sample would leave it.
  virtual void reset(Filter& filter, bool biases, const TwistNoise& sampled = {}) const = 0;

  /// (v in m/s, omega in rad/s) in the body's axes, and its covariance.
  virtual Vector6d twist(const Filter& filter, const ImuTrack& imu, Stamp now) const = 0;
  virtual Matrix6d twistCovariance(const Filter& filter, const ImuTrack& imu) const = 0;
  /// Of what the sensors measure of the twist, same order, units and axes.
  virtual Vector6d bias(const Filter& filter) const = 0;
  /// What the gyro reads at rest (rad/s) and its covariance.
  Eigen::Vector3d gyroBias(const Filter& filter) const { return bias(filter).tail<3>(); }
  virtual Eigen::Matrix3d gyroBiasCovariance(const Filter& filter) const = 0;
  /// m/s^2; 0 where there is no accelerometer.
  virtual Eigen::Vector3d accelerometerBias(const Filter& /*filter*/) const {
    return Eigen::Vector3d::Zero();
  }
  /// In units of its covariance, squared (6 degrees of freedom): how far `error` (coreRows()) moves the
  /// twist.
  virtual double twistChange(const Filter& filter, const Eigen::VectorXd& error) const = 0;
};

} // namespace vi_ekf_slam

#pragma once

#include <optional>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/motion/motion_model.hpp"

namespace vi_ekf_slam {

/// A body with gyro and accelerometer: its velocity v (world, z up) and both biases b_g and b_a move with the
/// IMU's samples as input (Hartley et al., IJRR 2020, sections V and VI),
///
///   R' = R G0(w dt),   v' = v + (R G1(w dt) a + g) dt,   p' = p + v dt + (R G2(w dt) a + g / 2) dt^2
///
/// with w = w_m - b_g, a = (I - M) a_m - b_a held over a step and G_k the integrals of the rotation (so3).
/// M (3x3) is what is wrong with the scale and the alignment of the accelerometer's axes: constant, and known
/// to a per cent where an IMU is used as it comes.
class Inertial : public MotionModel {
 public:
  struct Options {
    ImuNoise noise;
    bool noise_given = false;                ///< the noise holds in place of what the messages say
    std::string noise_file;                  ///< that gave it, for messages; empty: the configuration
    double gravity = 9.81;                   ///< m/s^2
    double gyro_bias_sigma = 0.1;            ///< rad/s, standard deviation beforehand, per axis
    double accelerometer_bias_sigma = 0.2;   ///< m/s^2
    double accelerometer_scale_sigma = 0.01; ///< 1, of each element of M; 0: there is none. Of datasheets
    double velocity_sigma = 15.0;            ///< m/s, of an unknown velocity
    double measured_velocity_sigma = 0.1;    ///< m/s, of a measured one without a covariance
  };

  explicit Inertial(const Options& options) : options_(options) {}

  /// Names of its variables: m/s along the world's axes, rad/s and m/s^2 along the IMU's, 1 (column by
  /// column).
  static constexpr const char *kVelocity = "velocity", *kGyroBias = "gyro_bias",
                              *kAccelerometerBias = "accelerometer_bias",
                              *kAccelerometerScale = "accelerometer_scale";

  void addTo(Filter& filter) override;
  bool begin(Filter& filter, const InitialState& state) const override;
  std::vector<std::string> variables() const override;
  bool measuresVelocity() const override { return false; }
  void setBiasPrior(Filter& filter, const TwistBias& bias) override;
  void propagate(Filter& filter, const ImuTrack& imu, Stamp from, Stamp to) const override;
  void process(Filter& /*filter*/, const ImuSample& /*sample*/) const override {} ///< it is an input
  LinearMeasurement measure(const Filter& filter, const VelocitySample& sample) const override;
  Eigen::Matrix3d noiseOf(const ImuSample& sample, const ImuTrack& imu) const override;
  Eigen::Matrix3d noiseOf(const VelocitySample& sample) const override;
  void processStandstill(Filter& filter, const ImuTrack& imu, Stamp now, double dt) const override;
  bool mayStand(const Filter& filter) const override;
  void reset(Filter& filter, bool biases, const TwistNoise& sampled = {}) const override;
  Vector6d twist(const Filter& filter, const ImuTrack& imu, Stamp now) const override;
  Matrix6d twistCovariance(const Filter& filter, const ImuTrack& imu) const override;
  Vector6d bias(const Filter& filter) const override;
  Eigen::Matrix3d gyroBiasCovariance(const Filter& filter) const override;
  Eigen::Vector3d accelerometerBias(const Filter& filter) const override;
  double twistChange(const Filter& filter, const Eigen::VectorXd& error) const override;

 private:
  void resetBiases(Filter& filter) const;
  /// I - M.
  Eigen::Matrix3d unscaling(const Filter& filter) const;

  Options options_;
  Eigen::Vector3d prior_gyro_bias_ = Eigen::Vector3d::Zero(); ///< mean
  Handle velocity_ = 0, gyro_bias_ = 0, accelerometer_bias_ = 0;
  std::optional<Handle> accelerometer_scale_; ///< nothing: known
};

} // namespace vi_ekf_slam

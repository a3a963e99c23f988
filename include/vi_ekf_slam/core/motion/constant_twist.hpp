#pragma once

#include <string>
#include <vector>

#include "vi_ekf_slam/core/motion/motion_model.hpp"

namespace vi_ekf_slam {

/// The body's twist nu = (v, omega) is a random walk, white noise on its derivative; gyro and velocity are
/// measurements of it plus their biases, each at its own rate. For bodies without an accelerometer, and for
/// cameras alone.
class ConstantTwist : public MotionModel {
 public:
  /// Root spectral densities are per axis (x ahead, y left, z up), and (velocity, angular velocity); sigmas
  /// standard deviations.
  struct Options {
    /// m/s^1.5 and rad/s^1.5: how hard the body can accelerate. A car's, with room for the rare bump: between
    /// the RMS (0.1 to 0.3, 0.03 to 0.07, 0.04 to 0.14; 0.03 to 0.07, 0.03 to 0.1, 0.01 to 0.03) and the 99 %
    /// quantile (0.2 to 0.7, 0.1 to 0.2, 0.1 to 0.4; 0.1 to 0.25, 0.1 to 0.26, 0.02 to 0.1) of the increments
    /// of what an INS measured on six short drives.
    Vector6d twist_density = (Vector6d() << 0.5, 0.08, 0.08, 0.1, 0.15, 0.1).finished();
    Vector6d bias_density = Vector6d::Zero(); ///< m/s^1.5 and rad/s^1.5: random walk of the biases
    Vector6d prior_twist_sigma = (Vector6d() << 15.0, 1.0, 1.0, 0.3, 0.3, 0.5).finished();
    Vector6d prior_bias_sigma = (Vector6d() << 1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01).finished();
    double velocity_sigma = 0.1; ///< m/s, of a sample without a covariance: wheel odometry's
    double gyro_sigma = 0.01;    ///< rad/s, of a sample without a covariance: a MEMS gyro's
  };

  explicit ConstantTwist(const Options& options) : options_(options) {}

  /// Names of its variables: (v, omega) in m/s and rad/s, body's axes, and the bias of what is measured of
  /// it.
  static constexpr const char *kTwist = "twist", *kBias = "twist_bias";

  void addTo(Filter& filter) override;
  std::vector<std::string> variables() const override { return {kTwist, kBias}; }
  void setBiasPrior(Filter& filter, const TwistBias& bias) override;
  void setOpticalBody() override;
  SE3 startPose() const override;
  void propagate(Filter& filter, double dt) const;
  void propagate(Filter& filter, const ImuTrack& /*imu*/, Stamp from, Stamp to) const override {
    propagate(filter, secondsBetween(from, to));
  }
  void process(Filter& filter, const ImuSample& sample) const override;
  LinearMeasurement measure(const Filter& filter, const VelocitySample& sample) const override;
  Eigen::Matrix3d noiseOf(const ImuSample& sample) const;
  Eigen::Matrix3d noiseOf(const ImuSample& sample, const ImuTrack& /*imu*/) const override {
    return noiseOf(sample);
  }
  Eigen::Matrix3d noiseOf(const VelocitySample& sample) const override;
  void processStandstill(Filter& filter, const ImuTrack& imu, Stamp now, double dt) const override;
  void reset(Filter& filter, bool biases, const TwistNoise& sampled = {}) const override;
  Vector6d twist(const Filter& filter, const ImuTrack& /*imu*/, Stamp /*now*/) const override {
    return filter.variables().mean(twist_);
  }
  Matrix6d twistCovariance(const Filter& filter, const ImuTrack& /*imu*/) const override {
    return filter.covariance(twist_);
  }
  Vector6d bias(const Filter& filter) const override { return filter.variables().mean(bias_); }
  Eigen::Matrix3d gyroBiasCovariance(const Filter& filter) const override;
  double twistChange(const Filter& filter, const Eigen::VectorXd& error) const override;

 private:
  void resetBiases(Filter& filter) const;

  Options options_;
  Vector6d prior_bias_ = Vector6d::Zero();
  Handle twist_ = 0, bias_ = 0;
  bool is_optical_ = false, is_bias_told_ = false;
};

} // namespace vi_ekf_slam

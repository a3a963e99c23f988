#pragma once

#include <deque>
#include <optional>

#include "vi_ekf_slam/core/sensors/measurement.hpp"

namespace vi_ekf_slam {

/// What calibrations state of an IMU, as root spectral densities per axis. The defaults are an ordinary MEMS
/// IMU's (ADIS16448 and the like).
struct ImuNoise {
  double gyro_density = 2e-4;          ///< rad/s/sqrt(Hz), white noise of the gyro
  double accelerometer_density = 2e-3; ///< m/s^2/sqrt(Hz), white noise of the accelerometer
  double gyro_walk = 2e-5;             ///< rad/s^2/sqrt(Hz), random walk of its bias
  double accelerometer_walk = 3e-3;    ///< m/s^3/sqrt(Hz), random walk of its bias
};

/// What an IMU says of a time between two of its samples.
struct ImuInterval {
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();         ///< mean, rad/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero(); ///< mean specific force, m/s^2
  /// By which both change from its begin to its end.
  Eigen::Vector3d rate_change = Eigen::Vector3d::Zero(), acceleration_change = Eigen::Vector3d::Zero();
  /// Spectral densities of the white noise of both, rad^2/s and m^2/s^3.
  Eigen::Matrix3d rate_density = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d acceleration_density = Eigen::Matrix3d::Zero();
};

/// The IMU's last sample and the one that follows: its input between the two, which is taken as the parabola
/// through them and the sample before, and how far that can be wrong where they lie far apart, or where the
/// body shakes more than the IMU's own noise and faster than it is sampled: that is measured by the fourth
/// differences of the samples, which leave nothing of a motion that the samples follow (white noise of
/// variance s^2 makes 70 s^2 of them).
class ImuTrack {
 public:
  /// `noise_given`: whether the noise holds in place of what the messages say.
  ImuTrack(const ImuNoise& noise, bool noise_given) : noise_(noise), noise_given_(noise_given) {}

  /// The next sample is known before the estimate gets there.
  void expect(const ImuSample& next);
  /// As if one like those that are known came then; nothing where none is.
  void expectAt(Stamp stamp);
  /// The estimate has got to it.
  void reach(const ImuSample& measured);
  /// Over [from, to], which no sample but the last one and the next divides.
  ImuInterval over(Stamp from, Stamp to) const;
  /// The rate at a stamp, with the gyro's bias, rad/s; zero before the first sample.
  Eigen::Vector3d rateAt(Stamp stamp) const;
  /// 3x3 of the white noise of one sample of the gyro, (rad/s)^2; of the last one.
  Eigen::Matrix3d gyroNoise(const ImuSample& sample) const;
  Eigen::Matrix3d gyroNoise() const { return gyroNoise(last_.value_or(ImuSample())); }

 private:
  struct Reading {
    Eigen::Vector3d rate = Eigen::Vector3d::Zero(), acceleration = Eigen::Vector3d::Zero();
  };
  ImuSample completed(ImuSample sample) const;
  Reading at(Stamp stamp) const;
  Reading bend(Stamp from, Stamp to) const;
  void noteDifferences(const ImuSample& sample);
  /// s, of what is no gap.
  double longestInterval() const;

  ImuNoise noise_;
  bool noise_given_;
  std::optional<ImuSample> before_, last_, next_;
  std::optional<Stamp> accelerated_; ///< of the last sample that had an acceleration
  double period_ = 0.01;             ///< s between samples; as is usual, before two have told
  double usual_ = 0.0;               ///< s, the mean of the last intervals
  double intervals_ = 0.0;           ///< how many these are
  std::deque<Reading> recent_;       ///< the last samples, regularly spaced
  Reading shaking_;                  ///< variances of one sample, (rad/s)^2 and (m/s^2)^2, of the last second
  double weight_ = 0.0;              ///< of how many samples
};

} // namespace vi_ekf_slam

#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "motion/inertial_core.hpp"
#include "vi_ekf_slam/core/slam/inertial_estimator.hpp"

/// A body with an IMU that flies about in front of a wall of points, and its truth.
namespace vi_ekf_slam::test {

struct FlightOptions {
  bool at_rest = false;
  double motion = 1.0;                        ///< by how much it moves and turns, of what it does by itself
  double imu_rate = 200.0, frame_rate = 10.0; ///< Hz; samples fall onto frames
  ImuNoise noise;                             ///< of the samples, and how their biases walk
  double pixel = 0.0;                         ///< px, of the features
  std::size_t points = 100;
  double farther = 1.0; ///< times, is the wall
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero(), accelerometer_bias = Eigen::Vector3d::Zero();
  double heading = 0.0; ///< rad, of the middle of its view; the wall is there
};

class Flight {
 public:
  Flight(unsigned seed, const FlightOptions& options)
      : random_(seed),
        options_(options),
        gyro_bias_(options.gyro_bias),
        accelerometer_bias_(options.accelerometer_bias) {
    const Eigen::Matrix3d ahead = so3::Exp({0.0, 0.0, options.heading});
    for (std::size_t i = 0; i < options.points; ++i)
      points_.push_back(options.farther * ahead *
                        Eigen::Vector3d(random_.uniform(6.0, 14.0), random_.uniform(-7.0, 7.0),
                                        random_.uniform(-3.0, 3.0)));
    for (int i = 0; i < 3; ++i) phase_[i] = random_.uniform(0.0, 6.0);
  }

  // The truth `t` s after the start; the world's z axis points up.
  SE3 pose(double t) const { return {rotation(t), position(t)}; }
  Eigen::Vector3d velocity(double t) const { return derivative(t, 1); }
  const Eigen::Vector3d& gyroBias() const { return gyro_bias_; } ///< of now
  const Eigen::Vector3d& accelerometerBias() const { return accelerometer_bias_; }

  double seconds() const { return static_cast<double>(count_) / options_.imu_rate; } ///< of the next sample
  Stamp stamp() const { return kBegin + fromSeconds(seconds()); }

  /// The samples up to the next frame, and it, as the estimator gets them.
  template <typename Change>
  FrameReport feed(Estimator& estimator, const Change& change) {
    const int per_frame = static_cast<int>(std::lround(options_.imu_rate / options_.frame_rate));
    for (int i = 0; i < per_frame; ++i) feedSample(estimator, change);
    StereoFrame seen = frame();
    change(seen);
    return estimator.process(seen);
  }
  FrameReport feed(Estimator& estimator) {
    return feed(estimator, [](auto&) {});
  }
  template <typename Change>
  void feedSample(Estimator& estimator, const Change& change) {
    ImuSample now = sample();
    change(now);
    estimator.expect(now);
    estimator.process(now);
  }
  /// The time goes on without a measurement.
  void skip(double seconds) { count_ += static_cast<long>(std::lround(seconds * options_.imu_rate)); }

  ImuSample sample() {
    const double t = seconds(), dt = 1.0 / options_.imu_rate;
    const ImuNoise& n = options_.noise;
    ImuSample sample;
    sample.stamp = last_ = stamp();
    sample.angular_velocity = rate(t) + gyro_bias_ + random_.gaussian<3>(n.gyro_density / std::sqrt(dt));
    sample.acceleration = rotation(t).transpose() * (derivative(t, 2) + Eigen::Vector3d(0.0, 0.0, kGravity)) +
                          accelerometer_bias_ + random_.gaussian<3>(n.accelerometer_density / std::sqrt(dt));
    gyro_bias_ += random_.gaussian<3>(n.gyro_walk * std::sqrt(dt));
    accelerometer_bias_ += random_.gaussian<3>(n.accelerometer_walk * std::sqrt(dt));
    ++count_;
    return sample;
  }
  /// At the last sample's stamp.
  StereoFrame frame() {
    StereoFrame frame;
    frame.stamp = last_;
    const SE3 world_T_imu = pose(lastSeconds());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const auto z = seen(points_[i], world_T_imu);
      if (z)
        frame.features.push_back({static_cast<FeatureId>(i + 1), *z + random_.gaussian<4>(options_.pixel)});
    }
    return frame;
  }
  double lastSeconds() const { return timeOf(last_); } ///< of the last sample
  static double timeOf(Stamp stamp) { return secondsBetween(kBegin, stamp); }

  /// What is true at the next sample, with this covariance of the errors as InitialState has them; off by
  /// `error`.
  InitialState initialState(const Eigen::Matrix<double, 15, 1>& sigma,
                            const Eigen::Matrix<double, 15, 1>& error) const {
    InitialState state;
    const double t = seconds();
    state.stamp = stamp();
    state.world_T_imu = SE3(so3::Exp(-error.segment<3>(3)) * rotation(t), position(t) - error.head<3>());
    state.velocity = velocity(t) - error.segment<3>(6);
    state.gyro_bias = gyro_bias_ - error.segment<3>(9);
    state.accelerometer_bias = accelerometer_bias_ - error.tail<3>();
    state.covariance = sigma.cwiseAbs2().asDiagonal();
    return state;
  }

  /// Of the flight's own draws.
  Random& random() { return random_; }

 private:
  static constexpr Stamp kBegin = 1000000000000;

  Eigen::Vector3d position(double t) const { return derivative(t, 0); }
  /// Of the position, which is a sum of sines and begins anywhere.
  Eigen::Vector3d derivative(double t, int order) const {
    constexpr double kPi = 3.14159265358979323846;
    const Eigen::Vector3d size(0.8, 1.0, 0.4), frequency(0.9, 1.3, 1.7);
    Eigen::Vector3d x;
    for (int i = 0; i < 3; ++i)
      x[i] = options_.motion * size[i] * std::pow(frequency[i], order) *
             std::sin(frequency[i] * t + phase_[i] + 0.5 * kPi * order);
    if (options_.at_rest) x = order == 0 ? derivativeAtStart() : Eigen::Vector3d::Zero();
    return x;
  }
  Eigen::Vector3d derivativeAtStart() const { return {0.3, -0.2, 0.1}; }
  Eigen::Matrix3d rotation(double t) const {
    const double s = options_.at_rest ? 0.0 : t, m = options_.motion;
    return so3::Exp({0.0, 0.0, options_.heading + 0.3 * m * std::sin(0.7 * s + phase_[0])}) *
           so3::Exp({0.15 * m * std::sin(1.1 * s + phase_[1]), 0.1 * m * std::sin(0.9 * s + phase_[2]), 0.0});
  }
  /// R^T R' by a stencil of the fourth order.
  Eigen::Vector3d rate(double t) const {
    if (options_.at_rest) return Eigen::Vector3d::Zero();
    constexpr double h = 1e-3;
    const auto turn = [&](double by) { return so3::Log(rotation(t - by).transpose() * rotation(t + by)); };
    return (8.0 * turn(h) - turn(2.0 * h)) / (12.0 * h);
  }

  Random random_;
  FlightOptions options_;
  Eigen::Vector3d gyro_bias_, accelerometer_bias_, phase_;
  std::vector<Eigen::Vector3d> points_;
  long count_ = 0;
  Stamp last_ = kBegin;
};

inline InvariantConfig inertialConfig(const FlightOptions& options, double pixel_sigma = 0.5) {
  InvariantConfig config;
  config.choice = MotionChoice::kInertial;
  config.inertial.noise = options.noise;
  config.inertial.noise_given = true;
  config.inertial.accelerometer_scale_sigma = 0.0; // as its axes are
  config.stereo.pixel_sigma = pixel_sigma;
  return config;
}

inline InertialEstimator inertialEstimator(const InvariantConfig& config) {
  InertialEstimator estimator(config);
  estimator.setRig(exampleRig());
  return estimator;
}

/// A saved variable's mean.
inline Eigen::Vector3d savedVariable(const SavedMap& map, const std::string& name) {
  for (const SavedVariable& variable : map.variables) {
    if (variable.name == name) return variable.mean;
  }
  ADD_FAILURE() << "no " << name;
  return Eigen::Vector3d::Zero();
}

/// With biases, headed somewhere.
inline FlightOptions startFlight(bool at_rest) {
  FlightOptions options;
  options.at_rest = at_rest;
  options.pixel = 0.3;
  options.gyro_bias = {0.01, -0.02, 0.015};
  options.accelerometer_bias = {0.05, -0.05, 0.03};
  options.heading = 0.7;
  return options;
}

/// A change of what is measured, of the accelerations alone.
template <typename Change>
auto ofAccelerations(const Change& change) {
  return [change](auto& measurement) {
    if constexpr (std::is_same_v<std::decay_t<decltype(measurement)>, ImuSample>)
      *measurement.acceleration = change(*measurement.acceleration);
  };
}

/// Of the features alone, one by one.
template <typename Change>
auto ofFeatures(const Change& change) {
  return [change](auto& measurement) {
    if constexpr (std::is_same_v<std::decay_t<decltype(measurement)>, StereoFrame>)
      std::for_each(measurement.features.begin(), measurement.features.end(), change);
  };
}

/// Feeds frames until it has started, for 5 s at most.
template <typename Change>
void startOf(Flight& flight, InertialEstimator& estimator, const Change& change) {
  while (!estimator.hasStarted() && flight.seconds() < 5.0) flight.feed(estimator, change);
}
inline void startOf(Flight& flight, InertialEstimator& estimator) {
  startOf(flight, estimator, [](auto&) {});
}

} // namespace vi_ekf_slam::test

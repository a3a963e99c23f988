#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "covariances.hpp"
#include "numeric.hpp"
#include "street.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

/// Drives to take the right-invariant filter along, and what to expect of its estimates.
namespace vi_ekf_slam::test {

/// A car that drives round for ever (10 Hz, unless told otherwise), and sees a fixed number of points, each
/// until it leaves the view.
class Road {
 public:
  struct Noise {
    double velocity = 0.0, gyro = 0.0, pixel = 0.0; ///< m/s, rad/s, px, standard deviations
  };

  /// Points are up to `farthest` m away when they come into view.
  Road(unsigned seed, std::size_t features, const Noise& noise, double farthest = 40.0)
      : random_(seed), noise_(noise), farthest_(farthest), points_(features) {
    for (Point& point : points_) spawn(point);
  }

  /// From now on: frames a second, and gyro and velocity samples from one to the next, of which the last has
  /// the frame's stamp.
  void setRates(double frames, int samples_per_frame) {
    step_s_ = 1.0 / (frames * samples_per_frame);
    samples_per_frame_ = samples_per_frame;
  }
  /// From now on; (m/s, rad/s).
  void setTwist(const Vector6d& twist) { twist_ = twist; }
  /// Of the gyro's samples from now on, rad/s.
  void setGyroBias(const Eigen::Vector3d& bias) { gyro_bias_ = bias; }

  /// Gyro, velocity and frame of now.
  ImuSample gyro() { return {stamp_, twist_.tail<3>() + gyro_bias_ + random_.gaussian<3>(noise_.gyro), {}}; }
  VelocitySample velocity() { return {stamp_, twist_.head<3>() + random_.gaussian<3>(noise_.velocity), {}}; }
  StereoFrame frame() {
    StereoFrame frame;
    frame.stamp = stamp_;
    for (Point& point : points_) {
      if (!seen(point.world, pose_)) spawn(point);
      frame.features.push_back({point.id, *seen(point.world, pose_) + random_.gaussian<4>(noise_.pixel)});
    }
    return frame;
  }

  /// By the time from one sample to the next.
  void move() {
    pose_ = (pose_ * SE3::Exp(step_s_ * twist_)).normalized();
    stamp_ += fromSeconds(step_s_);
  }

  /// Somewhere else at once: pose() * motion.
  void displace(const SE3& motion) { pose_ = (pose_ * motion).normalized(); }

  FrameReport feed(Estimator& estimator) {
    return feed(estimator, [](StereoFrame&) {});
  }
  /// `change` makes of the frame what the front end says.
  template <typename Change>
  FrameReport feed(Estimator& estimator, const Change& change) {
    feedSamples(estimator);
    StereoFrame seen = frame();
    change(seen);
    const FrameReport report = estimator.process(seen);
    truth_ = pose_;
    move();
    return report;
  }
  /// What is measured up to the next frame.
  void feedSamples(Estimator& estimator) {
    for (int i = 0; i < samples_per_frame_; ++i) {
      if (i > 0) move();
      estimator.process(gyro());
      estimator.process(velocity());
    }
  }

  const SE3& truth() const { return truth_; } ///< at the last frame fed
  const SE3& pose() const { return pose_; }   ///< now
  Stamp stamp() const { return stamp_; }      ///< now
  const Vector6d& twist() const { return twist_; }

 private:
  struct Point {
    FeatureId id = 0;
    Eigen::Vector3d world = Eigen::Vector3d::Zero();
  };

  void spawn(Point& point) {
    point.id = next_id_++;
    const SE3 world_T_cam = pose_ * rig_.cam_T_imu.inverse();
    do {
      const double depth = random_.uniform(6.0, farthest_);
      const double u = random_.uniform(50.0, 1190.0), v = random_.uniform(20.0, 350.0);
      point.world = world_T_cam * Eigen::Vector3d((u - rig_.camera.cu) / rig_.camera.fu * depth,
                                                  (v - rig_.camera.cv) / rig_.camera.fv * depth, depth);
    } while (!seen(point.world, pose_));
  }

  Random random_;
  Noise noise_;
  double farthest_;
  Eigen::Vector3d gyro_bias_ = Eigen::Vector3d::Zero();
  StereoRig rig_ = exampleRig();
  SE3 pose_, truth_;
  Vector6d twist_ = (Vector6d() << 8.0, 0.1, 0.0, 0.0, 0.0, 0.15).finished();
  Stamp stamp_ = fromSeconds(1000.0);
  double step_s_ = 0.1;
  int samples_per_frame_ = 1;
  std::vector<Point> points_;
  FeatureId next_id_ = 1;
};

inline const Road::Noise kQuiet{}, kTypical{0.5, 0.05, 0.7};

/// The default filter, told that tracks do not slip and what the samples of kTypical are worth.
InvariantConfig steadyTracks();

InvariantEstimator withRig(const InvariantConfig& config = steadyTracks());

double positionError(const Estimator& estimator, const SE3& truth);

double rotationError(const Estimator& estimator, const SE3& truth);

void expectSame(const StateEstimate& a, const StateEstimate& b, double tolerance);

bool isPositiveDefinite(const Matrix6d& P);

/// An estimator that has driven `frames` of `road`.
InvariantEstimator driven(Road& road, int frames, const InvariantConfig& config = steadyTracks());

/// An estimator brought to the road's next frame, and that frame.
struct Ahead {
  InvariantEstimator estimator;
  StereoFrame frame;
};

Ahead ahead(Road& road, int frames, const InvariantConfig& config = steadyTracks());

/// The state predicted to the stamp of `frame`.
StateEstimate predicted(InvariantEstimator estimator, const StereoFrame& frame);

} // namespace vi_ekf_slam::test

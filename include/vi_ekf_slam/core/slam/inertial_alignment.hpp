#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "vi_ekf_slam/core/motion/gravity_fit.hpp"
#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

namespace vi_ekf_slam {

/// What pictures and IMU say together about the last two seconds: stereo odometry tells how the IMU moved,
/// and a linear fit what gravity, velocity and the biases were (fitGravity).
class InertialAlignment {
 public:
  /// What to look at where IMU and pictures contradict each other; it ends a parenthesis.
  static constexpr char kAxes[] =
      "are the IMU's axes those of the transform to the camera, are the stamps of both of one clock, is the "
      "baseline right, are features as exact as their sigma says, and is what is seen at rest?)";

  explicit InertialAlignment(const InvariantConfig& config);

  void setRig(const StereoRig& rig);
  void setBiasPrior(const TwistBias& bias);
  void setGates(const Gates& gates);
  void expect(const ImuSample& next) { imu_.expect(next); }
  void process(const ImuSample& sample);
  void process(const VelocitySample& sample);
  /// What odometry made of it.
  FrameReport process(const StereoFrame& frame);
  /// The camera's clock is another one (s, to be added to its stamps): what was seen by it moves.
  void setTimeOffset(double time_offset);
  double timeOffset() const { return config_.rig.time_offset; }

  struct Result {
    std::optional<InitialState> state; ///< at the first measurement: of the linear fit, with a wide prior
    std::string problem;               ///< in words, where there is none
    bool contradicts = false;          ///< the IMU cannot have moved as the pictures have it
    /// The vertical in the body's axes at the last frame, where there is a state.
    Eigen::Vector3d up = Eigen::Vector3d::Zero();
  };
  Result align();
  /// Whether it looks back as far as it ever does.
  bool isFull() const;
  /// By stamp, from the IMU's sample before the oldest pose on.
  const std::deque<Measurement>& measurements() const { return measurements_; }
  static bool isImu(const Measurement& measurement) { return streamOf(measurement) == Stream::kImu; }
  const ImuTrack& imu() const { return imu_; }
  StateEstimate state() const { return odometry_->state(); }

 private:
  void begin();
  void forgetOld(Stamp now);
  void order();
  bool startsAtOrigin() const { return origin_ && !poses_.empty() && poses_.front().stamp == *origin_; }
  std::vector<SeenPose> weighedPoses() const;
  /// Empty: none.
  std::string contradictionOf(const GravityFit& fit) const;
  InitialState stateOf(const GravityFit& fit) const;

  InvariantConfig config_;
  std::unique_ptr<InvariantEstimator> odometry_; ///< of the pictures and the gyro
  std::deque<Measurement> measurements_;
  std::deque<SeenPose> poses_;                                    ///< of the IMU, by odometry
  std::optional<Stamp> origin_;                                   ///< of the pose that odometry began with
  Eigen::Vector3d first_step_variance_ = Eigen::Vector3d::Zero(); ///< m^2, of the position after it
  ImuTrack imu_;                                                  ///< all of its samples so far
};

} // namespace vi_ekf_slam

#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/filter/validity.hpp"
#include "vi_ekf_slam/core/health/divergence_monitor.hpp"
#include "vi_ekf_slam/core/tracking/frame_update.hpp"

namespace vi_ekf_slam {

/// What an estimate is worth, and what is done when it can no longer be believed: the state machine between a
/// valid estimate, its last valid checkpoint, and a new start from there.
class Recovery {
 public:
  struct Options {
    DivergenceMonitor::Options monitor;
    /// By which the static world is displaced from one frame to the next, beyond what the vehicle drives, m;
    /// a smaller displacement is left to the monitor. 0, or a window of 0: not looked for.
    double jump_m = 10.0;
  };

  Recovery(const Options& options, const MotionModel& motion);

  /// The body has moved on.
  void travel(double distance_m, double angle_rad);
  /// The local map is what the frame saw, or was corrected by it.
  void useFrame() { unused_distance_ = unused_angle_ = 0.0; }
  /// A sample measured a part of the twist, with noise of this covariance (3x3).
  void noteGyro(Stamp stamp, const Eigen::Matrix3d& noise) { gyro_ = {stamp, noise}; }
  void noteVelocity(Stamp stamp, const Eigen::Matrix3d& noise) { velocity_ = {stamp, noise}; }

  /// Judges what a frame said about the filter, and where that is not believed any more makes it as uncertain
  /// as the error may be. The local map is to be begun anew then.
  Divergence judge(Filter& filter, const LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
                   const std::vector<Association>& associations, const FrameOutcome& outcome);
  /// For what the estimate has not been believed since this was last asked.
  Divergence takeDivergence() { return std::exchange(divergence_, Divergence::kNone); }
  /// tellPose.
  bool relocate(Filter& filter, const SE3& pose, const Matrix6d& covariance);
  /// The next frame's travel begins here.
  void endFrame() { distance_ = angle_ = 0.0; }

  /// Remembers the pose if the filter is valid. False if it is not: it must be begun anew at the checkpoint.
  bool check(const Filter& filter, Stamp stamp, bool thoroughly);
  const SE3& checkpointPose() const { return pose_; }
  /// 6x6 of (dp, theta) for a new start at `now`: what is known of the checkpoint, and the travel since.
  Matrix6d checkpointCovariance(Stamp now, double speed) const;

 private:
  bool isJump(const Filter& filter, const SE3& motion) const;
  void followJump(Filter& filter, const SE3& motion);
  void goOnLost(Filter& filter, Divergence divergence, Stamp now);
  void distrust(Filter& filter, const SE3& motion, const Matrix6d& covariance, bool biases,
                const TwistNoise& sampled = {});

  struct Sample {
    Stamp stamp = 0;
    std::optional<Eigen::Matrix3d> noise;
  };

  Options options_;
  const MotionModel* motion_;
  DivergenceMonitor monitor_;
  double distance_ = 0.0, angle_ = 0.0;               ///< since the last frame
  double unused_distance_ = 0.0, unused_angle_ = 0.0; ///< since the last one that was used
  Sample gyro_, velocity_;                            ///< the last ones
  bool has_followed_ = false;                         ///< a frame has agreed with the one before
  Divergence divergence_ = Divergence::kNone;         ///< the last one
  Stamp stamp_ = 0;
  SE3 pose_;
  Matrix6d covariance_ = Matrix6d::Zero();
};

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/health/recovery.hpp"

#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/filter/pose_reset.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/rigid_consensus.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kJumpRotation = 0.5;  // rad; the world does not turn by this much from frame to frame
constexpr double kJumpUsed = 0.5;      // of a frame's features that fit: then nothing has jumped
constexpr double kFramesOfLag = 2.0;   // by which a front end that repeats itself may displace the world
constexpr double kJumpPrecision = 0.1; // of a jump, that it is known to
constexpr double kLostPosition = 1.0;  // m, standard deviation at least of what is not believed
constexpr double kLostRotation = 0.1;  // rad
constexpr double kSampled = 0.5;       // s, from one sample to the next where the twist is measured
constexpr double kAnyAngle = 1.0;      // rad, standard deviation: may be any, as far as that is linear

/// The landmarks that were matched, and where they are seen.
std::vector<Displaced> displacedPoints(const Filter& filter, const LandmarkMap& map, const StereoModel& model,
                                       const StereoFrame& frame,
                                       const std::vector<Association>& associations) {
  std::vector<Displaced> points;
  for (const Association& a : associations) {
    const auto seen =
        model.triangulate(filter, frame.features[a.feature].pixels, frame.features[a.feature].sigma);
    const Handle landmark = map.active()[a.landmark].variable;
    if (!seen) continue;
    points.push_back({filter.variables().point(landmark), seen->position,
                      seen->noise + Eigen::Matrix3d(filter.covariance(landmark))});
  }
  return points;
}

} // namespace

Recovery::Recovery(const Options& options, const MotionModel& motion)
    : options_(options), motion_(&motion), monitor_(options.monitor) {}

void Recovery::travel(double distance_m, double angle_rad) {
  distance_ += distance_m;
  angle_ += angle_rad;
  unused_distance_ += distance_m;
  unused_angle_ += angle_rad;
}

Divergence Recovery::judge(Filter& filter, const LandmarkMap& map, const StereoModel& model,
                           const StereoFrame& frame, const std::vector<Association>& associations,
                           const FrameOutcome& outcome) {
  const std::size_t used = countTrue(outcome.used);
  Divergence divergence =
      monitor_.add({frame.stamp, distance_, angle_, associations.size(), used, outcome.skipped,
                    outcome.capped_nis, outcome.skipped ? 0 : 3 * associations.size()});
  const bool follows =
      used > 0 && static_cast<double>(used) >= kJumpUsed * static_cast<double>(associations.size());
  // Until a frame agrees with the first one, that is as likely to be wrong as one that contradicts it.
  const bool may_be_jump =
      options_.monitor.window_s > 0.0 && options_.jump_m > 0.0 && has_followed_ && !follows;
  has_followed_ = has_followed_ || follows;
  if (divergence == Divergence::kNone && !may_be_jump) return Divergence::kNone;
  const auto motion = commonMotion(displacedPoints(filter, map, model, frame, associations));
  if (divergence == Divergence::kNone) {
    if (!motion || !isJump(filter, *motion)) return Divergence::kNone;
    divergence = Divergence::kJump;
    followJump(filter, *motion);
  } else if (divergence == Divergence::kRejections && !motion) {
    // Features that do not even agree with each other cannot have misled the estimate: they were not used.
    monitor_.restart();
  } else {
    goOnLost(filter, divergence, frame.stamp);
  }
  return divergence_ = divergence;
}

/// Frames that were refused have not misled the twist, which samples measured meanwhile.
void Recovery::goOnLost(Filter& filter, Divergence divergence, Stamp now) {
  TwistNoise sampled;
  if (divergence == Divergence::kRejections) {
    if (secondsBetween(velocity_.stamp, now) <= kSampled) sampled.velocity = velocity_.noise;
    if (secondsBetween(gyro_.stamp, now) <= kSampled) sampled.gyro = gyro_.noise;
  }
  const Matrix6d lost = independentPose(std::max(kLostPosition, monitor_.distance()),
                                        std::clamp(monitor_.angle(), kLostRotation, kAnyAngle));
  distrust(filter, SE3(), lost, true, sampled);
}

/// Whether the motion (world) is more than what the vehicle may have driven, since the last frame and, with
/// what is in view going along (a lorry), since the last one that was used.
bool Recovery::isJump(const Filter& filter, const SE3& motion) const {
  const Eigen::Vector3d& p = filter.pose().translation();
  return (motion * p - p).norm() > options_.jump_m + kFramesOfLag * distance_ + unused_distance_ ||
         so3::Log(motion.rotation()).norm() > kJumpRotation + unused_angle_;
}

/// The static world says so, but nothing else does: that nothing has moved is to remain likely.
void Recovery::followJump(Filter& filter, const SE3& motion) {
  const SE3& pose = filter.pose();
  Vector6d displacement;
  displacement << motion * pose.translation() - pose.translation(), so3::Log(motion.rotation());
  Matrix6d covariance = independentPose(kJumpPrecision * displacement.head<3>().norm(),
                                        kJumpPrecision * displacement.tail<3>().norm());
  covariance += displacement * displacement.transpose();
  distrust(filter, pose.inverse() * motion * pose, covariance, false);
}

/// The pose is moved and may be wrong by so much more; what moves is to be measured anew.
void Recovery::distrust(Filter& filter, const SE3& motion, const Matrix6d& covariance, bool biases,
                        const TwistNoise& sampled) {
  resetPose(filter, motion, covariance);
  motion_->reset(filter, biases, sampled);
  monitor_.restart();
}

bool Recovery::relocate(Filter& filter, const SE3& pose, const Matrix6d& covariance) {
  monitor_.restart();
  return tellPose(filter, pose, covariance);
}

bool Recovery::check(const Filter& filter, Stamp stamp, bool thoroughly) {
  if (!isValid(filter, thoroughly)) {
    divergence_ = Divergence::kCovariance;
    return false;
  }
  stamp_ = stamp;
  pose_ = filter.pose();
  covariance_ = filter.covariance().topLeftCorner<6, 6>();
  return true;
}

Matrix6d Recovery::checkpointCovariance(Stamp now, double speed) const {
  const double elapsed = secondsBetween(stamp_, now);
  return covariance_ + independentPose(std::max(kLostPosition, elapsed * speed), kLostRotation);
}

} // namespace vi_ekf_slam

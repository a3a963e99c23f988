/// What InvariantEstimator does when its estimate can no longer be believed.
#include <Eigen/Cholesky>
#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/invariant/jump.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr double kJumpRotation = 0.5;     // rad; the world does not turn by this much from frame to frame
constexpr double kJumpUsed = 0.2;         // of a frame's features that fit: then nothing has jumped
constexpr double kFramesOfLag = 2.0;      // by which a front end that repeats itself may displace the world
constexpr double kJumpPrecision = 0.1;    // of a jump, that it is known to
constexpr double kDoubtfulPosition = 1.0; // m, standard deviation at least
constexpr double kDoubtfulRotation = 0.1; // rad
constexpr double kAnyAngle = 1.8;         // rad, standard deviation of an angle that may be any
constexpr double kNegligible = 1e-9;      // of a correlation matrix's eigenvalues

} // namespace

/// Whether all is finite and no variance negative; `thoroughly`: and the base's covariance positive
/// semidefinite.
bool InvariantEstimator::isSound(bool thoroughly) const {
  const auto P = state_.covariance();
  const auto base = P.topLeftCorner<kLandmarks, kLandmarks>();
  const SE3& pose = state_.pose();
  if (!pose.rotation().allFinite() || !pose.translation().allFinite() || !state_.twist().allFinite() ||
      !state_.bias().allFinite() || !base.allFinite() || !(P.diagonal().array() >= 0.0).all() ||
      !P.diagonal().allFinite()) {
    return false;
  }
  if (!thoroughly) return true;
  using Base = Eigen::Matrix<double, kLandmarks, 1>;
  const Base scale = base.diagonal().unaryExpr([](double v) { return v > 0.0 ? 1.0 / std::sqrt(v) : 0.0; });
  Eigen::Matrix<double, kLandmarks, kLandmarks> correlation = scale.asDiagonal() * base * scale.asDiagonal();
  correlation.diagonal() = Base::Constant(1.0 + kNegligible);
  return Eigen::LLT<decltype(correlation)>(correlation).info() == Eigen::Success;
}

/// Remembers what is sound, and goes back to it from what is not.
void InvariantEstimator::keepSound(bool thoroughly) {
  if (isSound(thoroughly)) {
    sound_ = {*stamp_, state_.pose(), state_.poseCovariance(), rotation_variance_, drift_};
  } else {
    rebuild();
  }
}

void InvariantEstimator::rebuild() {
  divergence_ = Divergence::kCovariance;
  archiveInactive();
  recalled_.clear();
  state_ = initialState(config_);
  state_.displace(sound_.pose, sound_.pose_covariance);
  gyro_graded_ = velocity_graded_ = false;
  rotation_variance_ = sound_.rotation_variance;
  drift_ = sound_.drift;
  scale_ = ScaleMonitor(config_.scale_sigma, config_.scale_significance);
  standstill_ = StandstillDetector(config_.standstill_px);
  const double elapsed = secondsBetween(sound_.stamp, *stamp_);
  doubt(std::max(kDoubtfulPosition, elapsed * config_.prior_twist_sigma[0]), kDoubtfulRotation);
}

Divergence InvariantEstimator::judge(const StereoFrame& frame, const PooledVector<Observation>& observations,
                                     const FrameOutcome& outcome) {
  const auto used = static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
  const Divergence divergence = monitor_.add({frame.stamp, distance_, angle_, observations.size(), used,
                                              outcome.rejected, outcome.nis, outcome.nis_dof});
  const bool may_be_jump = config_.divergence_jump_m > 0.0 && last_frame_ &&
                           static_cast<double>(used) < kJumpUsed * static_cast<double>(observations.size());
  if (divergence == Divergence::kNone && !may_be_jump) return Divergence::kNone;
  const auto motion = commonMotion(displacedPoints(frame, observations));
  if (divergence != Divergence::kNone) {
    // Features that do not even agree with each other cannot have misled the estimate: they were not used.
    if (divergence == Divergence::kRejections && !motion) {
      monitor_.restart();
    } else {
      doubtAll();
    }
    return divergence;
  }
  if (!motion || !isJump(*motion)) return Divergence::kNone;
  followJump(*motion);
  return Divergence::kJump;
}

std::vector<Displaced> InvariantEstimator::displacedPoints(
    const StereoFrame& frame, const PooledVector<Observation>& observations) const {
  std::vector<Displaced> points;
  for (const Observation& o : observations) {
    const auto sighting = model_->triangulate(state_, frame.features[o.feature].pixels, config_.max_depth_m);
    if (!sighting) continue;
    points.push_back({state_.landmarks()[o.landmark].position, sighting->position,
                      sighting->covariance + state_.relativeCovariance(State::offsetOf(o.landmark))});
  }
  return points;
}

/// Whether the motion (world) is more than what the vehicle may have driven.
bool InvariantEstimator::isJump(const SE3& motion) const {
  const Eigen::Vector3d& p = state_.pose().translation();
  return (motion * p - p).norm() > config_.divergence_jump_m + kFramesOfLag * distance_ ||
         so3::Log(motion.rotation()).norm() > kJumpRotation;
}

/// The static world says so, but nothing else does: that nothing has moved is to remain likely.
void InvariantEstimator::followJump(const SE3& motion) {
  const SE3& pose = state_.pose();
  Vector6d displacement;
  displacement << motion * pose.translation() - pose.translation(), so3::Log(motion.rotation());
  Vector6d precision;
  precision << Eigen::Vector3d::Constant(kJumpPrecision * displacement.head<3>().norm()),
      Eigen::Vector3d::Constant(kJumpPrecision * displacement.tail<3>().norm());
  Matrix6d covariance = displacement * displacement.transpose();
  covariance.diagonal() += precision.cwiseAbs2();
  doubt(pose.inverse() * motion * pose, covariance);
}

/// All that was estimated within the monitor's window.
void InvariantEstimator::doubtAll() {
  doubt(std::max(kDoubtfulPosition, monitor_.distance()),
        std::clamp(monitor_.angle(), kDoubtfulRotation, kAnyAngle));
  for (const Eigen::Index axis : {0, 3}) {
    state_.forget(kBias + axis, config_.prior_bias_sigma.segment<3>(axis));
  }
  gyro_graded_ = velocity_graded_ = false;
}

void InvariantEstimator::doubt(double position_sigma, double rotation_sigma) {
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(position_sigma), Eigen::Vector3d::Constant(rotation_sigma);
  doubt(SE3(), sigma.cwiseAbs2().asDiagonal());
}

/// The pose is moved and may be wrong by so much more; the twist is to be measured anew.
void InvariantEstimator::doubt(const SE3& motion, const Matrix6d& covariance) {
  state_.displace(motion, covariance);
  for (const Eigen::Index axis : {0, 3}) {
    state_.forget(kTwist + axis, config_.prior_twist_sigma.segment<3>(axis));
  }
  monitor_.restart();
}

} // namespace vi_ekf_slam::invariant

#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "vi_ekf_slam/core/invariant/frame_update.hpp"
#include "vi_ekf_slam/core/invariant/twist_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr double kMaxPixel = 1e6;          // px; beyond it a coordinate is not one of an image
constexpr std::size_t kScaleFeatures = 10; // used by the last frame, for its motion to be worth comparing
// The world frame IS the first IMU frame; not zero, so that the covariance stays positive definite.
constexpr double kPosePriorSigma = 1e-6;     // m, rad
constexpr double kStandstillVelocity = 0.02; // m/s, how still a body stands whose engine runs
constexpr double kStandstillRate = 0.002;    // rad/s
constexpr std::size_t kMaxArchived = 100000; // landmarks

Eigen::Matrix3d isotropic(double sigma) { return sigma * sigma * Eigen::Matrix3d::Identity(); }

} // namespace

InvariantEstimator::InvariantEstimator(const InvariantConfig& config)
    : config_(config),
      state_(initialState(config)),
      scale_(config.scale_sigma, config.scale_significance),
      drift_(config.drift_position, config.drift_rotation),
      standstill_(config.standstill_px),
      monitor_(config.divergence),
      sound_{0, {}, Matrix6d::Zero(), Eigen::Vector3d::Zero(), drift_},
      archive_(kMaxArchived) {}

State InvariantEstimator::initialState(const InvariantConfig& config) {
  return State({Vector6d::Constant(kPosePriorSigma), config.prior_twist_sigma, config.prior_bias_sigma},
               config.map.keep != MapKeep::kNone, config.map.deferred_mb << 20);
}

void InvariantEstimator::setRig(const StereoRig& rig) {
  model_.emplace(rig, config_.pixel_sigma, config_.min_depth_m);
  baseline_ = rig.camera.baseline;
}

void InvariantEstimator::setGates(const Gates& gates) { vi_ekf_slam::setGates(config_, gates); }

void InvariantEstimator::advanceTo(Stamp stamp) {
  if (resumed_) resume(stamp);
  if (stamp_ && stamp > *stamp_) {
    ProcessNoise noise{config_.twist_density, config_.bias_density};
    if (!config_.twist_state) noise.twist_density.setZero();
    const double dt = secondsBetween(*stamp_, stamp);
    const double distance = dt * state_.twist().head<3>().norm();
    distance_ += distance;
    driven_ += distance;
    angle_ += dt * state_.twist().tail<3>().norm();
    drift_.drive(state_.pose().translation(), distance);
    state_.propagate(dt, noise);
  }
  stamp_ = stamp;
}

void InvariantEstimator::process(const GyroSample& sample) {
  advanceTo(sample.stamp);
  const Eigen::Matrix3d noise = sample.covariance.value_or(isotropic(config_.gyro_sigma));
  gradeBias(3, noise, config_.gyro_sigma, gyro_graded_);
  standstill_.addGyro(sample.stamp, sample.angular_velocity - state_.bias().tail<3>(), noise,
                      state_.covariance().block<3, 3>(kBias + 3, kBias + 3));
  measure(3, sample.angular_velocity, noise);
  keepSound(false);
  last_gyro_ = GyroSample{sample.stamp, sample.angular_velocity, noise};
}

void InvariantEstimator::process(const VelocitySample& sample) {
  advanceTo(sample.stamp);
  const Eigen::Matrix3d noise = sample.covariance.value_or(isotropic(config_.velocity_sigma));
  gradeBias(0, noise, config_.velocity_sigma, velocity_graded_);
  const Eigen::Vector3d velocity = sample.linear_velocity - state_.bias().head<3>();
  standstill_.addVelocity(sample.stamp, velocity, noise);
  if (last_used_ >= kScaleFeatures) {
    scale_.compare(velocity, noise, state_.twist().head<3>(),
                   state_.covariance().block<3, 3>(kTwist, kTwist));
  }
  measure(0, sample.linear_velocity, noise);
  keepSound(false);
}

void InvariantEstimator::measure(Eigen::Index axis, const Eigen::Vector3d& measured,
                                 const Eigen::Matrix3d& noise) {
  if (!config_.twist_state) state_.forget(kTwist + axis, config_.prior_twist_sigma.segment<3>(axis));
  measureTwist(state_, axis, measured, noise);
}

/// The bias that a sensor is given beforehand is that of one with the configured noise. Better sensors have
/// smaller biases, and from one grade to the next the bias falls about as the square of the noise.
void InvariantEstimator::gradeBias(Eigen::Index axis, const Eigen::Matrix3d& noise, double configured_sigma,
                                   bool& done) {
  if (done) return;
  done = true;
  const double ratio2 = noise.trace() / (3.0 * configured_sigma * configured_sigma);
  if (ratio2 < 1.0) state_.forget(kBias + axis, ratio2 * config_.prior_bias_sigma.segment<3>(axis));
}

FrameReport InvariantEstimator::process(const StereoFrame& frame) {
  advanceTo(frame.stamp);
  FrameReport report;
  report.stamp = frame.stamp;
  report.features = frame.features.size();
  // What is out of view does not take part in the drift of what is in view.
  if (state_.keepsInactive()) state_.loosen(drift_.take());
  handleStandstill(frame);
  forgetOutcastsNotIn(frame);
  PooledVector<std::size_t> usable;
  std::size_t outcasts_in_frame = 0;
  for (std::size_t i = 0; model_ && i < frame.features.size(); ++i) {
    if (!isUsable(frame.features[i].pixels)) continue;
    if (outcasts_.count(frame.features[i].id)) {
      ++outcasts_in_frame;
    } else {
      usable.push_back(i);
    }
  }
  report.invalid = report.features - usable.size() - outcasts_in_frame;
  if (model_) {
    model_->setBaseline(baseline_ * scale_.factor());
    PooledVector<std::size_t> unknown;
    PooledVector<bool> keep;
    const PooledVector<Observation> observations = match(frame, usable, unknown, keep);
    const FrameOutcome outcome =
        FrameUpdate(config_, *model_).apply(state_, frame, observations, manoeuvreSince(last_frame_));
    const Divergence divergence = judge(frame, observations, outcome);
    for (std::size_t i = 0; i < observations.size(); ++i) {
      if (outcome.used[i]) {
        state_.addObservations(observations[i].landmark, 1);
        continue;
      }
      keep[observations[i].landmark] = false;
      if (outcome.rejected) {
        unknown.push_back(observations[i].feature); // nothing speaks against this one: it starts afresh
      } else {
        // What contradicts the world once does so again (a car, a track that slides): never trusted again.
        outcasts_.insert(frame.features[observations[i].feature].id);
      }
    }
    report.used = static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
    report.rejected = outcasts_in_frame + observations.size() - report.used;
    report.frame_rejected = outcome.rejected;
    report.nis = outcome.nis;
    report.nis_dof = outcome.nis_dof;
    if (divergence != Divergence::kNone) {
      divergence_ = divergence;
      keep.assign(keep.size(), false);
      outcasts_.clear();
      recalled_.clear();
      unknown = usable;
    }
    if (!recalled_.empty()) keepRecalled(frame, unknown, keep, report);
    remove(keep, report);
    initialise(frame, unknown, report);
    if (state_.keepsInactive()) {
      boundInactive();
      revisit(report);
      recognisePlace(report);
      if (loaded_) relocalise(report);
    }
  }
  keepSound(true);
  if (std::exchange(loop_closed_, false) || report.place_recognised) rotation_variance_.setZero();
  keepRotationVariance();
  report.divergence = std::exchange(divergence_, Divergence::kNone);
  distance_ = angle_ = 0.0;
  last_used_ = report.used;
  last_frame_ = frame.stamp;
  report.landmarks = state_.landmarks().size();
  if (state_.keepsInactive()) report.inactive = state_.inactive().size();
  return report;
}

void InvariantEstimator::handleStandstill(const StereoFrame& frame) {
  if (!(config_.standstill_px > 0.0)) return;
  standstill_.addFrame(frame);
  if (!standstill_.stands(frame.stamp)) return;
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(kStandstillVelocity), Eigen::Vector3d::Constant(kStandstillRate);
  measureStandstill(state_, sigma);
}

/// Nothing that is measured tells how the whole world is turned, so its variance does not fall: where the
/// newest frame's noise averages out a little of what the last ones added, that much is put back. No gain
/// depends on it. A landmark or a place that was seen before does tell.
void InvariantEstimator::keepRotationVariance() {
  const Eigen::Vector3d now = poseCovariance().diagonal().tail<3>();
  // A hair more, so that rounding does not let it fall either.
  const Eigen::Vector3d missing = ((1.0 + 1e-12) * rotation_variance_ - now).cwiseMax(0.0);
  drift_.turn(state_.pose().translation(), missing);
  rotation_variance_ = now + missing;
}

/// An id that left may come back as something else.
void InvariantEstimator::forgetOutcastsNotIn(const StereoFrame& frame) {
  if (outcasts_.empty()) return;
  PooledHashSet<FeatureId> present;
  for (const StereoFeatureObservation& feature : frame.features) {
    if (outcasts_.count(feature.id)) present.insert(feature.id);
  }
  outcasts_.swap(present);
}

Manoeuvre InvariantEstimator::manoeuvreSince(std::optional<Stamp> last_frame) const {
  Manoeuvre manoeuvre;
  if (!last_frame || !config_.twist_state) return manoeuvre;
  manoeuvre.dt = secondsBetween(*last_frame, *stamp_);
  if (last_gyro_ && last_gyro_->stamp > *last_frame) manoeuvre.gyro = last_gyro_;
  return manoeuvre;
}

bool InvariantEstimator::isUsable(const StereoPixels& pixels) const {
  return pixels.allFinite() && pixels.cwiseAbs().maxCoeff() <= kMaxPixel &&
         pixels[0] - pixels[2] >= config_.min_disparity &&
         std::abs(pixels[1] - pixels[3]) <= config_.max_row_offset;
}

/// Observations of known landmarks. `unknown` receives the other usable features, `seen` whether each
/// landmark is in view.
PooledVector<Observation> InvariantEstimator::match(const StereoFrame& frame,
                                                    const PooledVector<std::size_t>& usable,
                                                    PooledVector<std::size_t>& unknown,
                                                    PooledVector<bool>& seen) const {
  const PooledHashMap<FeatureId, std::size_t> landmark_of_id = state_.indexById();
  seen.assign(state_.landmarks().size(), false);
  PooledVector<Observation> observations;
  for (const std::size_t feature : usable) {
    const auto known = landmark_of_id.find(frame.features[feature].id);
    auto observation = known == landmark_of_id.end()
                           ? std::nullopt
                           : model_->observe(state_, known->second, frame.features[feature].pixels);
    if (observation && !seen[known->second]) {
      seen[known->second] = true;
      observation->feature = feature;
      observations.push_back(*observation);
    } else {
      unknown.push_back(feature);
    }
  }
  return observations;
}

void InvariantEstimator::initialise(const StereoFrame& frame, const PooledVector<std::size_t>& features,
                                    FrameReport& report) {
  for (const std::size_t feature : features) {
    const auto sighting = model_->triangulate(state_, frame.features[feature].pixels, config_.max_depth_m);
    if (!sighting) continue;
    state_.addLandmark(frame.features[feature].id, sighting->position, sighting->covariance);
    state_.beginTrack(state_.landmarks().size() - 1, driven_);
    ++report.initialised;
  }
}

StateEstimate InvariantEstimator::state() const {
  StateEstimate estimate;
  estimate.stamp = stamp_.value_or(0);
  estimate.world_T_imu = state_.pose();
  estimate.pose_covariance = poseCovariance();
  estimate.twist = state_.twist();
  estimate.twist_covariance = state_.covariance().block<6, 6>(kTwist, kTwist);
  return estimate;
}

Matrix6d InvariantEstimator::poseCovariance() const {
  return state_.poseCovariance() + drift_.ofPose(state_.pose().translation());
}

} // namespace vi_ekf_slam::invariant

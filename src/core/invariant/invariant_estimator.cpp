#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "vi_ekf_slam/core/invariant/consensus.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr double kMaxPixel = 1e6;          // px; beyond it a coordinate is not one of an image
constexpr std::size_t kScaleFeatures = 10; // used by the last frame, for its motion to be worth comparing
// The world frame IS the first IMU frame; not zero, so that the covariance stays positive definite.
constexpr double kPosePriorSigma = 1e-6; // m, rad

Prior priorOf(const InvariantConfig& config) {
  return {Vector6d::Constant(kPosePriorSigma), config.prior_twist_sigma, config.prior_bias_sigma};
}

Eigen::Matrix3d isotropic(double sigma) { return sigma * sigma * Eigen::Matrix3d::Identity(); }

template <typename T>
std::vector<T> chosen(const std::vector<T>& all, const std::vector<bool>& choice) {
  std::vector<T> result;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (choice[i]) result.push_back(all[i]);
  }
  return result;
}

} // namespace

InvariantEstimator::InvariantEstimator(const InvariantConfig& config)
    : config_(config), state_(priorOf(config)), scale_(config.scale_sigma, config.scale_significance) {}

void InvariantEstimator::setRig(const StereoRig& rig) {
  model_.emplace(rig, config_.pixel_sigma, config_.min_depth_m);
  baseline_ = rig.camera.baseline;
}

void InvariantEstimator::advanceTo(Stamp stamp) {
  if (stamp_ && stamp > *stamp_) {
    ProcessNoise noise{config_.twist_density, config_.bias_density};
    if (!config_.twist_state) noise.twist_density.setZero();
    state_.propagate(secondsBetween(*stamp_, stamp), noise);
  }
  stamp_ = stamp;
}

void InvariantEstimator::process(const GyroSample& sample) {
  advanceTo(sample.stamp);
  measureTwist(3, sample.angular_velocity, sample.covariance.value_or(isotropic(config_.gyro_sigma)));
}

void InvariantEstimator::process(const VelocitySample& sample) {
  advanceTo(sample.stamp);
  const Eigen::Matrix3d noise = sample.covariance.value_or(isotropic(config_.velocity_sigma));
  if (last_used_ >= kScaleFeatures) {
    scale_.compare(sample.linear_velocity - state_.bias().head<3>(), noise, state_.twist().head<3>(),
                   state_.covariance().block<3, 3>(kTwist, kTwist));
  }
  measureTwist(0, sample.linear_velocity, noise);
}

/// z = nu + b + noise for three of the twist's components, `axis` 0 (linear) or 3 (angular).
void InvariantEstimator::measureTwist(Eigen::Index axis, const Eigen::Vector3d& measured,
                                      const Eigen::Matrix3d& noise) {
  const Eigen::Index twist = kTwist + axis, bias = kBias + axis;
  if (!config_.twist_state) state_.forgetTwist(twist, config_.prior_twist_sigma.segment<3>(axis));
  const auto P = state_.covariance();
  Eigen::MatrixXd HP = P.middleRows<3>(twist) + P.middleRows<3>(bias);
  const Eigen::Matrix3d S = HP.middleCols<3>(twist) + HP.middleCols<3>(bias) + noise;
  const Eigen::Vector3d innovation =
      measured - state_.twist().segment<3>(axis) - state_.bias().segment<3>(axis);
  state_.correct(std::move(HP), S, innovation);
}

FrameReport InvariantEstimator::process(const StereoFrame& frame) {
  advanceTo(frame.stamp);
  FrameReport report;
  report.stamp = frame.stamp;
  report.features = frame.features.size();
  std::vector<std::size_t> usable;
  for (std::size_t i = 0; model_ && i < frame.features.size(); ++i) {
    if (isUsable(frame.features[i].pixels)) usable.push_back(i);
  }
  report.invalid = report.features - usable.size();
  if (model_) {
    model_->setBaseline(baseline_ * scale_.factor());
    std::vector<std::size_t> unknown;
    std::vector<bool> keep;
    const std::vector<Observation> observations = match(frame, usable, unknown, keep);
    const std::vector<bool> used = update(frame, observations, report);
    for (std::size_t i = 0; i < observations.size(); ++i) {
      if (used[i]) {
        state_.countObservation(observations[i].landmark);
      } else {
        // What contradicts the map may be something new under an old name: it starts afresh.
        keep[observations[i].landmark] = false;
        unknown.push_back(observations[i].feature);
      }
    }
    remove(keep, report);
    initialise(frame, unknown, report);
  }
  last_used_ = report.used;
  report.landmarks = state_.landmarks().size();
  return report;
}

bool InvariantEstimator::isUsable(const StereoPixels& pixels) const {
  return pixels.allFinite() && pixels.cwiseAbs().maxCoeff() <= kMaxPixel &&
         pixels[0] - pixels[2] >= config_.min_disparity &&
         std::abs(pixels[1] - pixels[3]) <= config_.max_row_offset;
}

/// Observations of known landmarks. `unknown` receives the other usable features, `seen` whether each
/// landmark is in view.
std::vector<Observation> InvariantEstimator::match(const StereoFrame& frame,
                                                   const std::vector<std::size_t>& usable,
                                                   std::vector<std::size_t>& unknown,
                                                   std::vector<bool>& seen) const {
  std::unordered_map<FeatureId, std::size_t> landmark_of_id;
  for (std::size_t i = 0; i < state_.landmarks().size(); ++i) landmark_of_id[state_.landmarks()[i].id] = i;
  seen.assign(state_.landmarks().size(), false);
  std::vector<Observation> observations;
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

/// Corrects the state; returns which observations did.
std::vector<bool> InvariantEstimator::update(const StereoFrame& frame,
                                             const std::vector<Observation>& observations,
                                             FrameReport& report) {
  std::vector<bool> used(observations.size(), false);
  if (observations.empty()) return used;
  if (updateWithConsensus(observations, used, report)) {
    if (config_.consensus) rescue(frame, observations, used, report);
  } else {
    report.frame_rejected = true;
    used.assign(observations.size(), false);
  }
  report.used = static_cast<std::size_t>(std::count(used.begin(), used.end(), true));
  report.rejected = observations.size() - report.used;
  return used;
}

/// False when the frame contradicts the state as a whole; then nothing was changed.
bool InvariantEstimator::updateWithConsensus(const std::vector<Observation>& observations,
                                             std::vector<bool>& used, FrameReport& report) {
  const Eigen::MatrixXd HP = model_->crossCovariance(state_, observations);
  const Eigen::MatrixXd S = model_->innovationCovariance(observations, HP);
  if (config_.consensus) {
    const double threshold = 4.0 * config_.consensus_px * config_.consensus_px;
    used = largestConsensus(observations, S, model_->noise(), threshold, config_.plausible_gate);
  } else {
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const auto row = 3 * static_cast<Eigen::Index>(i);
      const Eigen::Matrix3d own = S.block<3, 3>(row, row);
      used[i] = observations[i].innovation.dot(own.llt().solve(observations[i].innovation)) < config_.gate;
    }
  }
  const std::vector<Observation> agreeing = chosen(observations, used);
  if (agreeing.empty()) return false;
  const auto rows = 3 * static_cast<Eigen::Index>(agreeing.size());
  Eigen::MatrixXd HP_used(rows, HP.cols()), S_used(rows, rows);
  std::vector<Eigen::Index> from;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (used[i]) from.push_back(3 * static_cast<Eigen::Index>(i));
  }
  for (std::size_t i = 0; i < from.size(); ++i) {
    const auto to = 3 * static_cast<Eigen::Index>(i);
    HP_used.middleRows<3>(to) = HP.middleRows<3>(from[i]);
    for (std::size_t j = 0; j < from.size(); ++j) {
      S_used.block<3, 3>(to, 3 * static_cast<Eigen::Index>(j)) = S.block<3, 3>(from[i], from[j]);
    }
  }
  const Eigen::VectorXd innovation = stackInnovations(agreeing);
  const Eigen::LLT<Eigen::MatrixXd> llt(S_used);
  const Eigen::VectorXd weighted = llt.solve(innovation);
  const double nis = innovation.dot(weighted);
  if (!(nis <= config_.frame_gate * static_cast<double>(rows))) return false;
  // What moves with the camera (a lorry that fills the view) agrees with itself, but not with the twist.
  const Vector6d twist_correction = HP_used.middleCols<6>(kTwist).transpose() * weighted;
  const Eigen::LLT<Matrix6d> twist_covariance(state_.covariance().block<6, 6>(kTwist, kTwist));
  if (!(twist_correction.dot(twist_covariance.solve(twist_correction)) <= config_.motion_gate)) return false;
  const auto corrected = state_.correct(std::move(HP_used), S_used, innovation, &model_->rig().cam_T_imu);
  if (!corrected) return false;
  report.nis += *corrected;
  report.nis_dof += static_cast<std::size_t>(rows);
  return true;
}

/// Takes back the observations that pass their own gate with the updated state: the consensus is judged in
/// pixels, and a young landmark may be honestly uncertain.
void InvariantEstimator::rescue(const StereoFrame& frame, const std::vector<Observation>& observations,
                                std::vector<bool>& used, FrameReport& report) {
  std::vector<Observation> again;
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (used[i]) continue;
    auto observation =
        model_->observe(state_, observations[i].landmark, frame.features[observations[i].feature].pixels);
    if (!observation) continue;
    const std::vector<Observation> one{*observation};
    const Eigen::Matrix3d S = model_->innovationCovariance(one, model_->crossCovariance(state_, one));
    if (observation->innovation.dot(S.llt().solve(observation->innovation)) < config_.gate) {
      again.push_back(*observation);
      index.push_back(i);
    }
  }
  if (again.empty()) return;
  const Eigen::MatrixXd HP = model_->crossCovariance(state_, again);
  const auto nis = state_.correct(HP, model_->innovationCovariance(again, HP), stackInnovations(again),
                                  &model_->rig().cam_T_imu);
  if (!nis) return;
  report.nis += *nis;
  report.nis_dof += 3 * again.size();
  for (const std::size_t i : index) used[i] = true;
}

void InvariantEstimator::remove(const std::vector<bool>& keep, FrameReport& report) {
  for (std::size_t i = keep.size(); i-- > 0;) {
    if (keep[i]) continue;
    if (state_.landmarks()[i].observations >= config_.map_min_observations) archive(estimateOf(i));
    state_.removeLandmark(i);
    ++report.removed;
  }
}

void InvariantEstimator::initialise(const StereoFrame& frame, const std::vector<std::size_t>& features,
                                    FrameReport& report) {
  for (const std::size_t feature : features) {
    const auto sighting = model_->triangulate(state_, frame.features[feature].pixels, config_.max_depth_m);
    if (!sighting) continue;
    state_.addLandmark(frame.features[feature].id, sighting->position, sighting->covariance);
    ++report.initialised;
  }
}

StateEstimate InvariantEstimator::state() const {
  StateEstimate estimate;
  estimate.stamp = stamp_.value_or(0);
  estimate.world_T_imu = state_.pose();
  estimate.pose_covariance = state_.poseCovariance();
  estimate.twist = state_.twist();
  estimate.twist_covariance = state_.covariance().block<6, 6>(kTwist, kTwist);
  return estimate;
}

LandmarkEstimate InvariantEstimator::estimateOf(std::size_t landmark) const {
  const Landmark& l = state_.landmarks()[landmark];
  return {l.id, l.position, state_.landmarkCovariance(landmark)};
}

void InvariantEstimator::archive(const LandmarkEstimate& landmark) {
  if (archive_.insert_or_assign(landmark.id, landmark).second) archive_order_.push_back(landmark.id);
  while (archive_.size() > config_.map_max_landmarks) {
    archive_.erase(archive_order_.front());
    archive_order_.pop_front();
  }
}

std::vector<LandmarkEstimate> InvariantEstimator::landmarks() const {
  std::map<FeatureId, LandmarkEstimate> all = archive_;
  for (std::size_t i = 0; i < state_.landmarks().size(); ++i) {
    all.insert_or_assign(state_.landmarks()[i].id, estimateOf(i));
  }
  std::vector<LandmarkEstimate> result;
  result.reserve(all.size());
  for (const auto& [id, landmark] : all) result.push_back(landmark);
  return result;
}

} // namespace vi_ekf_slam::invariant

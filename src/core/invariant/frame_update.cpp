#include "vi_ekf_slam/core/invariant/frame_update.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/invariant/chosen_blocks.hpp"
#include "vi_ekf_slam/core/invariant/consensus.hpp"
#include "vi_ekf_slam/core/invariant/twist_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kManoeuvreFeatures = 15; // fewer cannot outvote the model of motion

std::size_t countUsed(const FrameOutcome& outcome) {
  return static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
}

/// The correction by the chosen observations alone, from P H^T and S of all of them. At least one is chosen.
Correction correctionBy(const PooledVector<Observation>& observations, const PooledVector<bool>& chosen,
                        PooledMatrix PHt, PooledMatrix S, const Eigen::Matrix3d& noise) {
  Pooled<Eigen::VectorXd> innovation = stackInnovations(observations);
  keepChosen(chosen, PHt, S, innovation);
  PooledVector<Observation> used;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (chosen[i]) used.push_back(observations[i]);
  }
  return Correction(std::move(PHt), std::move(S), std::move(innovation), measurementMatrix(used), noise);
}

} // namespace

FrameOutcome FrameUpdate::apply(State& state, const StereoFrame& frame,
                                PooledVector<Observation> observations, const Manoeuvre& manoeuvre) const {
  FrameOutcome outcome;
  outcome.used.assign(observations.size(), false);
  if (observations.empty()) return outcome;
  std::optional<Plan> plan = makePlan(state, observations);
  const double enough = config_.manoeuvre_share * static_cast<double>(observations.size());
  const auto convinces = [enough](const std::optional<Plan>& p) {
    return p && static_cast<double>(countUsed(p->outcome)) >= enough;
  };
  if (!convinces(plan) && mayBeManoeuvre(observations, manoeuvre)) {
    State disturbed = state;
    if (allowManoeuvre(disturbed, frame, observations, manoeuvre)) {
      std::optional<Plan> second = makePlan(disturbed, observations);
      if (convinces(second)) {
        state = std::move(disturbed);
        plan = std::move(second);
      }
    }
  }
  if (!plan || !state.apply(std::move(plan->correction), &model_.rig().cam_T_imu)) {
    outcome.rejected = true;
    return outcome;
  }
  outcome = std::move(plan->outcome);
  if (config_.consensus) rescue(state, frame, observations, outcome);
  return outcome;
}

bool FrameUpdate::mayBeManoeuvre(const PooledVector<Observation>& observations,
                                 const Manoeuvre& manoeuvre) const {
  return config_.consensus && !config_.manoeuvre_density.isZero() &&
         observations.size() >= kManoeuvreFeatures && manoeuvre.dt > 0.0;
}

/// Most of the picture does not fit the prediction: perhaps it is the prediction that is wrong. With room for
/// a bump, and the gyro's word on it, the whole picture may agree. False where a landmark is out of sight
/// then.
bool FrameUpdate::allowManoeuvre(State& state, const StereoFrame& frame,
                                 PooledVector<Observation>& observations, const Manoeuvre& manoeuvre) const {
  state.disturb(manoeuvre.dt, {config_.manoeuvre_density, Vector6d::Zero()});
  if (manoeuvre.gyro) measureTwist(state, 3, manoeuvre.gyro->angular_velocity, *manoeuvre.gyro->covariance);
  PooledVector<Observation> moved;
  for (const Observation& observation : observations) {
    const auto again = observeAgain(state, frame, observation);
    if (!again) return false;
    moved.push_back(*again);
  }
  observations = std::move(moved);
  return true;
}

std::optional<Observation> FrameUpdate::observeAgain(const State& state, const StereoFrame& frame,
                                                     const Observation& observation) const {
  auto again = model_.observe(state, observation.landmark, frame.features[observation.feature].pixels);
  if (again) again->feature = observation.feature;
  return again;
}

/// Nothing when the frame contradicts the state as a whole.
std::optional<FrameUpdate::Plan> FrameUpdate::makePlan(const State& state,
                                                       const PooledVector<Observation>& observations) const {
  PooledMatrix PHt = model_.crossCovariance(state, observations);
  PooledMatrix S = model_.innovationCovariance(observations, PHt);
  FrameOutcome outcome;
  PooledVector<double> nis(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    nis[i] = squaredMahalanobis(observations[i].innovation, S.block<3, 3>(row, row));
    if (!(nis[i] < config_.plausible_gate)) continue;
    outcome.nis += nis[i];
    outcome.nis_dof += 3;
  }
  outcome.used = choose(observations, S, nis);
  const auto used = std::count(outcome.used.begin(), outcome.used.end(), true);
  if (used == 0) return std::nullopt;
  Correction correction =
      correctionBy(observations, outcome.used, std::move(PHt), std::move(S), model_.noise());
  if (!correction.isValid() || !(correction.nis() <= config_.frame_gate * 3.0 * static_cast<double>(used)))
    return std::nullopt;
  // What moves with the camera (a lorry that fills the view) agrees with itself, but not with the twist.
  const Vector6d twist = correction.error().segment<6>(kTwist);
  const Matrix6d twist_covariance = state.covariance().block<6, 6>(kTwist, kTwist);
  if (!(squaredMahalanobis(twist, twist_covariance) <= config_.motion_gate)) return std::nullopt;
  return Plan{std::move(outcome), std::move(correction)};
}

/// Which observations agree with each other, or, without consensus, with the prediction.
PooledVector<bool> FrameUpdate::choose(const PooledVector<Observation>& observations, const PooledMatrix& S,
                                       const PooledVector<double>& nis) const {
  const double gate = config_.consensus ? config_.plausible_gate : config_.gate;
  PooledVector<bool> passes(observations.size());
  std::transform(nis.begin(), nis.end(), passes.begin(), [gate](double n) { return n < gate; });
  if (!config_.consensus) return passes;
  const double threshold = 4.0 * config_.consensus_px * config_.consensus_px;
  return largestConsensus(observations, S, model_.noise(), threshold, passes);
}

/// Takes back the observations that pass their own gate with the updated state: the consensus is judged in
/// pixels, and a young landmark may be honestly uncertain.
void FrameUpdate::rescue(State& state, const StereoFrame& frame,
                         const PooledVector<Observation>& observations, FrameOutcome& outcome) const {
  PooledVector<Observation> again;
  PooledVector<std::size_t> index;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (outcome.used[i]) continue;
    const auto observation = observeAgain(state, frame, observations[i]);
    if (!observation) continue;
    again.push_back(*observation);
    index.push_back(i);
  }
  if (again.empty()) return;
  PooledMatrix PHt = model_.crossCovariance(state, again);
  PooledMatrix S = model_.innovationCovariance(again, PHt);
  PooledVector<bool> passes(again.size());
  for (std::size_t i = 0; i < again.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    passes[i] = squaredMahalanobis(again[i].innovation, S.block<3, 3>(row, row)) < config_.gate;
  }
  if (std::count(passes.begin(), passes.end(), true) == 0) return;
  if (!state.apply(correctionBy(again, passes, std::move(PHt), std::move(S), model_.noise()),
                   &model_.rig().cam_T_imu))
    return;
  for (std::size_t i = 0; i < again.size(); ++i) {
    if (passes[i]) outcome.used[index[i]] = true;
  }
}

} // namespace vi_ekf_slam::invariant

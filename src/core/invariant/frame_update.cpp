#include "vi_ekf_slam/core/invariant/frame_update.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/invariant/consensus.hpp"
#include "vi_ekf_slam/core/invariant/twist_update.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kManoeuvreFeatures = 15; // fewer cannot outvote the model of motion

std::size_t countUsed(const FrameOutcome& outcome) {
  return static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
}

} // namespace

FrameOutcome FrameUpdate::apply(State& state, const StereoFrame& frame, std::vector<Observation> observations,
                                const Manoeuvre& manoeuvre) const {
  FrameOutcome nothing;
  nothing.used.assign(observations.size(), false);
  if (observations.empty()) return nothing;
  const bool may_retry = config_.consensus && !config_.manoeuvre_density.isZero() &&
                         observations.size() >= kManoeuvreFeatures && manoeuvre.dt > 0.0;
  std::optional<State> before;
  if (may_retry) before = state;
  std::optional<FrameOutcome> outcome = withConsensus(state, observations);
  const double enough = config_.manoeuvre_share * static_cast<double>(observations.size());
  if (may_retry && (!outcome || static_cast<double>(countUsed(*outcome)) < enough)) {
    auto retried = afterManoeuvre(*before, frame, observations, manoeuvre);
    if (retried && static_cast<double>(countUsed(*retried)) >= enough) {
      state = std::move(*before);
      outcome = std::move(retried);
    }
  }
  if (!outcome) {
    nothing.rejected = true;
    return nothing;
  }
  if (config_.consensus) rescue(state, frame, observations, *outcome);
  return *outcome;
}

/// Most of the picture does not fit the prediction: perhaps it is the prediction that is wrong. With room for
/// a bump, and the gyro's word on it, the whole picture may agree.
std::optional<FrameOutcome> FrameUpdate::afterManoeuvre(State& state, const StereoFrame& frame,
                                                        std::vector<Observation> observations,
                                                        const Manoeuvre& manoeuvre) const {
  state.disturb(manoeuvre.dt, {config_.manoeuvre_density, Vector6d::Zero()});
  if (manoeuvre.gyro) {
    const double sigma = config_.gyro_sigma;
    measureTwist(state, 3, manoeuvre.gyro->angular_velocity,
                 manoeuvre.gyro->covariance.value_or(sigma * sigma * Eigen::Matrix3d::Identity()));
  }
  for (Observation& observation : observations) {
    auto again = model_.observe(state, observation.landmark, frame.features[observation.feature].pixels);
    if (!again) return std::nullopt;
    again->feature = observation.feature;
    observation = *again;
  }
  return withConsensus(state, observations);
}

/// Nothing, and no change, when the frame contradicts the state as a whole.
std::optional<FrameOutcome> FrameUpdate::withConsensus(State& state,
                                                       const std::vector<Observation>& observations) const {
  const Eigen::MatrixXd HP = model_.crossCovariance(state, observations);
  const Eigen::MatrixXd S = model_.innovationCovariance(observations, HP);
  FrameOutcome outcome;
  std::vector<double> nis(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    nis[i] = normalisedInnovationSquared(observations[i], S.block<3, 3>(row, row));
    if (!(nis[i] < config_.plausible_gate)) continue;
    outcome.nis += nis[i];
    outcome.nis_dof += 3;
  }
  outcome.used = choose(observations, S, nis);
  std::vector<std::size_t> agreeing;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (outcome.used[i]) agreeing.push_back(i);
  }
  if (agreeing.empty()) return std::nullopt;
  const auto rows = 3 * static_cast<Eigen::Index>(agreeing.size());
  Eigen::MatrixXd HP_used(rows, HP.cols()), S_used(rows, rows);
  Eigen::VectorXd innovation(rows);
  for (std::size_t i = 0; i < agreeing.size(); ++i) {
    const auto to = 3 * static_cast<Eigen::Index>(i), from = 3 * static_cast<Eigen::Index>(agreeing[i]);
    HP_used.middleRows<3>(to) = HP.middleRows<3>(from);
    innovation.segment<3>(to) = observations[agreeing[i]].innovation;
    for (std::size_t j = 0; j < agreeing.size(); ++j) {
      S_used.block<3, 3>(to, 3 * static_cast<Eigen::Index>(j)) =
          S.block<3, 3>(from, 3 * static_cast<Eigen::Index>(agreeing[j]));
    }
  }
  const Eigen::LLT<Eigen::MatrixXd> llt(S_used);
  const Eigen::VectorXd weighted = llt.solve(innovation);
  if (!(innovation.dot(weighted) <= config_.frame_gate * static_cast<double>(rows))) return std::nullopt;
  // What moves with the camera (a lorry that fills the view) agrees with itself, but not with the twist.
  const Vector6d twist_correction = HP_used.middleCols<6>(kTwist).transpose() * weighted;
  const Eigen::LLT<Matrix6d> twist_covariance(state.covariance().block<6, 6>(kTwist, kTwist));
  if (!(twist_correction.dot(twist_covariance.solve(twist_correction)) <= config_.motion_gate))
    return std::nullopt;
  if (!state.correct(std::move(HP_used), S_used, innovation, &model_.rig().cam_T_imu)) return std::nullopt;
  return outcome;
}

/// Which observations agree with each other, or, without consensus, with the prediction.
std::vector<bool> FrameUpdate::choose(const std::vector<Observation>& observations, const Eigen::MatrixXd& S,
                                      const std::vector<double>& nis) const {
  const double gate = config_.consensus ? config_.plausible_gate : config_.gate;
  std::vector<bool> passes(observations.size());
  std::transform(nis.begin(), nis.end(), passes.begin(), [gate](double n) { return n < gate; });
  if (!config_.consensus) return passes;
  const double threshold = 4.0 * config_.consensus_px * config_.consensus_px;
  return largestConsensus(observations, S, model_.noise(), threshold, passes);
}

/// Takes back the observations that pass their own gate with the updated state: the consensus is judged in
/// pixels, and a young landmark may be honestly uncertain.
void FrameUpdate::rescue(State& state, const StereoFrame& frame, const std::vector<Observation>& observations,
                         FrameOutcome& outcome) const {
  std::vector<Observation> again;
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (outcome.used[i]) continue;
    const auto observation =
        model_.observe(state, observations[i].landmark, frame.features[observations[i].feature].pixels);
    if (!observation) continue;
    const std::vector<Observation> one{*observation};
    const Eigen::Matrix3d S = model_.innovationCovariance(one, model_.crossCovariance(state, one));
    if (normalisedInnovationSquared(*observation, S) < config_.gate) {
      again.push_back(*observation);
      index.push_back(i);
    }
  }
  if (again.empty()) return;
  const Eigen::MatrixXd HP = model_.crossCovariance(state, again);
  if (!state.correct(HP, model_.innovationCovariance(again, HP), stackInnovations(again),
                     &model_.rig().cam_T_imu))
    return;
  for (const std::size_t i : index) outcome.used[i] = true;
}

} // namespace vi_ekf_slam::invariant

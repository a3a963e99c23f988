#include "vi_ekf_slam/core/tracking/frame_update.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/tracking/consensus.hpp"

namespace vi_ekf_slam {
namespace {

// Of a frame's tracks that must agree, for it to be used: among so many, as few agree by chance. Or fit
// these, where landmarks are young and it moves fast, so that the pixels' noise alone explains few.
constexpr double kLeastShare = 0.1, kMajority = 0.5;

double shareOf(const std::vector<bool>& chosen) {
  return static_cast<double>(countTrue(chosen)) / static_cast<double>(chosen.size());
}

} // namespace

Associations associate(const Filter& filter, const LandmarkMap& map, const StereoModel& model,
                       const StereoFrame& frame, const std::vector<std::size_t>& usable) {
  const auto landmark_of_id = map.indexById();
  std::vector<bool> seen(map.active().size(), false);
  Associations result;
  result.known.reserve(usable.size());
  result.measurements.reserve(usable.size());
  for (const std::size_t feature : usable) {
    const StereoFeatureObservation& f = frame.features[feature];
    const auto known = landmark_of_id.find(f.id);
    std::optional<LinearMeasurement> measurement;
    if (known != landmark_of_id.end() && !seen[known->second])
      measurement = model.observe(filter, map.active()[known->second].variable, f.pixels, f.sigma);
    if (measurement) {
      seen[known->second] = true;
      result.known.push_back({known->second, feature});
      result.measurements.push_back(std::move(*measurement));
    } else {
      result.unknown.push_back(feature);
    }
  }
  return result;
}

FrameOutcome FrameUpdate::apply(Filter& filter, std::vector<LinearMeasurement> measurements) const {
  FrameOutcome outcome;
  const std::size_t count = measurements.size();
  outcome.used.assign(count, false);
  outcome.missed.assign(count, false);
  if (count == 0) return outcome;
  Innovation in(filter.covariance(), std::move(measurements));
  std::vector<double> nis(count);
  for (std::size_t i = 0; i < count; ++i) {
    nis[i] = in.nisOf(i);
    outcome.capped_nis += nis[i] < options_.plausible_gate ? nis[i] : options_.plausible_gate;
    if (!(nis[i] < options_.plausible_gate)) continue;
    outcome.nis += nis[i];
    outcome.nis_dof += 3;
  }
  outcome.used = choose(in, nis);
  in.putFirst(outcome.used);
  const double agreeing = shareOf(outcome.used);
  outcome.skipped = agreeing == 0.0 || !isPossible(in, filter) || !reconsider(in, outcome) ||
                    (agreeing < kLeastShare && shareOf(outcome.used) < kMajority) ||
                    !filter.correct(in, model_.inverseDepthChart(filter, in.error()));
  if (outcome.skipped) {
    outcome.used.assign(count, false);
    outcome.nis = outcome.capped_nis = 0.0;
    outcome.nis_dof = 0;
  }
  return outcome;
}

/// What moves with the camera (a lorry that fills the view) agrees with itself, but not with the motion.
bool FrameUpdate::isPossible(Innovation& in, const Filter& filter) const {
  return in.factorise() && in.nis() <= options_.frame_gate * static_cast<double>(in.rows()) &&
         motion_.twistChange(filter, in.error()) <= options_.motion_gate;
}

/// Which measurements agree with each other, or, without consensus, with the prediction.
std::vector<bool> FrameUpdate::choose(const Innovation& in, const std::vector<double>& nis) const {
  const double gate = options_.consensus ? options_.plausible_gate : options_.gate;
  std::vector<bool> passes(nis.size());
  std::transform(nis.begin(), nis.end(), passes.begin(), [gate](double n) { return n < gate; });
  if (!options_.consensus) return passes;
  return largestConsensus(in, 4.0 * options_.consensus_sigmas * options_.consensus_sigmas, passes);
}

/// Takes back those that pass their own gate given the others: the consensus knows of a pixel's noise alone,
/// and a young landmark may be honestly uncertain.
bool FrameUpdate::reconsider(Innovation& in, FrameOutcome& outcome) const {
  std::vector<bool>& used = outcome.used;
  std::vector<bool> passes;
  std::size_t waiting = countTrue(used);
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i]) continue;
    const double nis = options_.consensus ? in.nisOf(waiting++) : kContradicts;
    passes.push_back(nis < options_.gate);
    used[i] = passes.back();
    outcome.missed[i] = !used[i] && nis < kContradicts;
  }
  return in.accept(passes);
}

} // namespace vi_ekf_slam

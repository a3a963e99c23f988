#include "vi_ekf_slam/core/tracking/frame_update.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/tracking/consensus.hpp"

namespace vi_ekf_slam {
namespace {

// Of a frame's tracks that must agree, for it to be used: among so many, as few agree by chance.
constexpr double kLeastShare = 0.1;

} // namespace

Associations associate(const Filter& filter, const LandmarkMap& map, const StereoModel& model,
                       const StereoFrame& frame, const std::vector<std::size_t>& usable) {
  const auto landmark_of_id = map.indexById();
  std::vector<bool> seen(map.active().size(), false);
  Associations result;
  for (const std::size_t feature : usable) {
    const StereoFeatureObservation& f = frame.features[feature];
    const auto known = landmark_of_id.find(f.id);
    const bool is_known = known != landmark_of_id.end() && !seen[known->second] &&
                          model.observe(filter, map.active()[known->second].variable, f.pixels);
    if (is_known) {
      seen[known->second] = true;
      result.known.push_back({known->second, feature});
    } else {
      result.unknown.push_back(feature);
    }
  }
  return result;
}

FrameOutcome FrameUpdate::apply(Filter& filter, const LandmarkMap& map, const StereoFrame& frame,
                                const std::vector<Association>& associations) const {
  FrameOutcome outcome;
  outcome.used.assign(associations.size(), false);
  if (associations.empty()) return outcome;
  std::vector<LinearMeasurement> measurements;
  for (const Association& a : associations)
    measurements.push_back(*model_.observe(filter, map.active()[a.landmark].variable,
                                           frame.features[a.feature].pixels));
  Innovation in(filter.covariance(), std::move(measurements));
  std::vector<double> nis(associations.size());
  for (std::size_t i = 0; i < associations.size(); ++i) {
    nis[i] = in.nisOf(i);
    outcome.capped_nis += nis[i] < options_.plausible_gate ? nis[i] : options_.plausible_gate;
    if (!(nis[i] < options_.plausible_gate)) continue;
    outcome.nis += nis[i];
    outcome.nis_dof += 3;
  }
  const std::vector<bool> chosen = choose(in, nis);
  const auto count = static_cast<double>(std::count(chosen.begin(), chosen.end(), true));
  in.keep(chosen);
  // The last one: what moves with the camera (a lorry that fills the view) agrees with itself, but not with
  // the motion.
  outcome.skipped = count < kLeastShare * static_cast<double>(chosen.size()) || count == 0.0 || !in.factorise() || !(in.nis() <= options_.frame_gate * 3.0 * count) ||
                    !(motion_.twistChange(filter, in.error()) <= options_.motion_gate) ||
                    !filter.correct(in, model_.inverseDepthChart(filter));
  if (outcome.skipped) {
    outcome.nis = outcome.capped_nis = 0.0;
    outcome.nis_dof = 0;
    return outcome;
  }
  outcome.used = chosen;
  if (options_.consensus) reconsider(filter, map, frame, associations, outcome);
  return outcome;
}

/// Which measurements agree with each other, or, without consensus, with the prediction.
std::vector<bool> FrameUpdate::choose(const Innovation& in, const std::vector<double>& nis) const {
  const double gate = options_.consensus ? options_.plausible_gate : options_.gate;
  std::vector<bool> passes(nis.size());
  std::transform(nis.begin(), nis.end(), passes.begin(), [gate](double n) { return n < gate; });
  if (!options_.consensus) return passes;
  return largestConsensus(in, 4.0 * options_.consensus_px * options_.consensus_px, passes);
}

/// Takes back those that pass their own gate with the corrected state: the consensus is judged in pixels, and
/// a young landmark may be honestly uncertain.
void FrameUpdate::reconsider(Filter& filter, const LandmarkMap& map, const StereoFrame& frame,
                             const std::vector<Association>& associations, FrameOutcome& outcome) const {
  std::vector<LinearMeasurement> again;
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < associations.size(); ++i) {
    if (outcome.used[i]) continue;
    auto measurement = model_.observe(filter, map.active()[associations[i].landmark].variable,
                                      frame.features[associations[i].feature].pixels);
    if (!measurement) continue;
    again.push_back(std::move(*measurement));
    index.push_back(i);
  }
  if (again.empty()) return;
  Innovation in(filter.covariance(), std::move(again));
  std::vector<bool> passes(index.size());
  for (std::size_t i = 0; i < index.size(); ++i) passes[i] = in.nisOf(i) < options_.gate;
  if (std::count(passes.begin(), passes.end(), true) == 0) return;
  in.keep(passes);
  if (!in.factorise() || !filter.correct(in, model_.inverseDepthChart(filter))) return;
  for (std::size_t i = 0; i < index.size(); ++i) {
    if (passes[i]) outcome.used[index[i]] = true;
  }
}

} // namespace vi_ekf_slam

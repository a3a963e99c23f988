#include "vi_ekf_slam/core/loops/appearance_loops.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/rigid_consensus.hpp"
#include "vi_ekf_slam/core/map/points.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kBetweenIndices = 1.0;  // s
constexpr double kBetweenAttempts = 0.2; // s
// How often the view must have changed since a landmark was in it: before, the tracks themselves connect
// them.
constexpr std::uint64_t kViewsBefore = 3;
constexpr std::size_t kObservations = 3; // of a landmark in view, for its place to be known
constexpr std::size_t kMostLookUps = 12; // in a frame: with 10,000 landmarks in reach 2.5 ms
constexpr std::size_t kLeastMatches = 5; // of a place
constexpr double kShare = 0.4;           // of the matches, that agree
constexpr double kLeastWidthShare = 0.1; // of their distance: what all but lies in a line tells no turn

/// Whether a landmark in view may be one that is known, by its covariance, which has the pose's in it.
auto reachOf(const Filter& filter, Handle landmark) {
  const Eigen::Vector3d at = filter.variables().point(landmark);
  const Eigen::Matrix3d S = filter.worldCovariance(landmark) + isotropic(kCornerSigma);
  return [at, S, within2 = kChiSquare3 * S.trace()](const KnownLook& known) {
    const Eigen::Vector3d d = known.position - at;
    // The largest eigenvalue of a sum is at most the sum of the traces.
    return d.squaredNorm() <= within2 + kChiSquare3 * known.covariance.trace() &&
           squaredMahalanobis(d, S + known.covariance) < kChiSquare3;
  };
}

bool mayReturn(const Landmark& landmark, const LandmarkMap& map) {
  return !landmark.descriptors.isEmpty() && landmark.observations >= kObservations && !landmark.in_map &&
         !landmark.reactivated && !landmark.suspect && !map.isInactive(landmark.id);
}

} // namespace

AppearanceLoops::AppearanceLoops() : look_ups_(kMostLookUps), agreement_(PlaceAgreement::byLooks()) {}

void AppearanceLoops::restart() {
  look_ups_.restart();
  agreement_.restart();
  known_ = AppearanceIndex();
  next_index_.reset();
}

Revisit AppearanceLoops::update(Filter& filter, LandmarkMap& map, Stamp now, Settling& settling) {
  if (filter.inactive().isEmpty()) return {};
  if (!next_index_ || now >= *next_index_) {
    next_index_ = now + fromSeconds(kBetweenIndices);
    index(filter, map);
  }
  if (known_.isEmpty()) return {};
  look_ups_.update(
      map, known_, [&map](const Landmark& l) { return mayReturn(l, map); },
      [&filter](const Landmark& l) { return reachOf(filter, l.variable); });
  if (next_attempt_ && now < *next_attempt_) return {};
  next_attempt_ = now + fromSeconds(kBetweenAttempts);
  const auto found = recognise(filter, map);
  if (!found) return {};
  const bool is_ready = settling.isReady(filter, now);
  if (!confirms(*found, filter, map) || !is_ready) return {};
  agreement_.restart();
  for (const auto& [is_now, was] : found->matches) look_ups_.forget(is_now);
  return fuseMatches(filter, map, found->matches, kLeastMatches, kCornerSigma);
}

/// What is recognised was so before, some way back.
bool AppearanceLoops::confirms(const Recognition& found, const Filter& filter, const LandmarkMap& map) {
  const auto landmarks = map.indexById();
  const Eigen::Vector3d about = filter.pose().translation();
  std::vector<Eigen::Vector3d> ways;
  for (const auto& [is_now, was] : found.matches)
    ways.push_back(filter.variables().point(map.active()[landmarks.at(is_now)].variable) - about);
  return agreement_.confirms(found, about, PlaceAgreement::kWayByLooks * centreOf(ways).norm());
}

/// What is long out of view, as it is known now.
void AppearanceLoops::index(const Filter& filter, const LandmarkMap& map) {
  const bool wanted = std::any_of(map.active().begin(), map.active().end(),
                                  [&map](const Landmark& l) { return mayReturn(l, map); });
  std::vector<KnownLook> known;
  if (wanted) {
    const auto active = map.indexById();
    map.forEachOutOfView(filter, [&](const Landmark& landmark, const InactiveStore::Estimate& estimate) {
      // Those that have a saved map's new ids have not been seen since: then they would have a track's.
      const bool is_of_before =
          landmark.id >= LandmarkMap::kRenumbered ||
          filter.inactive().deactivatedSince(landmark.variable) > kViewsBefore * map.keptOfView();
      if (!is_of_before || landmark.descriptors.isEmpty() || active.count(landmark.id)) return;
      known.push_back({landmark.id, estimate.variable.mean, estimate.covariance, landmark.descriptors});
    });
  }
  known_ = AppearanceIndex(std::move(known));
}

/// The matches on which most agree, as one rigid motion.
std::optional<Recognition> AppearanceLoops::recognise(const Filter& filter, const LandmarkMap& map) const {
  std::unordered_map<FeatureId, const KnownLook*> known;
  for (std::size_t i = 0; i < known_.size(); ++i) known.emplace(known_[i].id, &known_[i]);
  Matches matches;
  std::vector<Displaced> points;
  for (const auto& [index, before] : look_ups_.candidates(map)) {
    const Landmark& landmark = map.active()[index];
    const auto found = known.find(before);
    if (found == known.end() || !map.isInactive(before)) continue;
    matches.emplace_back(landmark.id, before);
    // Its error beside the pose's, and as much of what was seen before.
    points.push_back({found->second->position, filter.variables().point(landmark.variable),
                      2.0 * filter.covariance(landmark.variable) + isotropic(kCornerSigma)});
  }
  if (matches.size() < kLeastMatches) return std::nullopt;
  const auto motion = commonMotion(points, kShare);
  if (!motion) return std::nullopt;
  Recognition recognition{*motion, {}};
  std::vector<Eigen::Vector3d> positions;
  double distance = 0.0;
  for (const std::size_t i : agreeing(points, *motion)) {
    recognition.matches.push_back(matches[i]);
    positions.push_back(points[i].seen);
    distance += (points[i].seen - filter.pose().translation()).norm();
  }
  const auto count = static_cast<double>(positions.size());
  if (positions.size() < kLeastMatches || widthOf(positions) < kLeastWidthShare * distance / count)
    return std::nullopt;
  return recognition;
}

} // namespace vi_ekf_slam

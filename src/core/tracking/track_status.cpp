#include "vi_ekf_slam/core/tracking/track_status.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kBadFrames = 0.15; // s, for which frames that contradict the local map say nothing else
// s, for which the local map is believed against frames that only contradict it.
constexpr double kTrusted = 1.0;
// s, for which a rejected track must be seen in one place: a car would have gone on by several metres.
constexpr double kProbation = 2.0;
constexpr double kSameView = 3.665; // 70 %: of most points of one view
constexpr double kMostOfView = 0.5;

} // namespace

/// An id that left may come back as something else.
TrackStatus::Usable TrackStatus::usable(const Filter& filter, const StereoModel& model,
                                        const StereoFrame& frame) {
  Usable result;
  decltype(rejected_) still_rejected;
  std::unordered_set<FeatureId> still_suspect;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const FeatureId id = frame.features[i].id;
    if (isSuspect(id)) still_suspect.insert(id);
    const bool rejected = isRejected(id) && !hasStood(filter, model, frame, i);
    if (rejected) still_rejected.insert(*rejected_.find(id));
    if (!model.isUsable(frame.features[i].pixels, frame.features[i].sigma)) {
      ++result.invalid;
    } else if (rejected) {
      ++result.rejected;
    } else {
      result.features.push_back(i);
    }
  }
  rejected_.swap(still_rejected);
  suspects_.swap(still_suspect);
  return result;
}

void TrackStatus::reject(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                         std::size_t feature) {
  hasStood(filter, model, frame, feature); // from now on
  suspects_.insert(frame.features[feature].id);
}

/// Whether a rejected track is one of the static world. Else it is watched from here on.
bool TrackStatus::hasStood(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                           std::size_t feature) {
  const StereoFeatureObservation& f = frame.features[feature];
  std::optional<StandingTrack>& track = rejected_[f.id];
  const auto seen =
      model.isUsable(f.pixels, f.sigma) ? model.triangulate(filter, f.pixels, f.sigma) : std::nullopt;
  if (seen && track && track->distanceTo(filter, *seen) < kChiSquare3)
    return secondsBetween(track->since(), frame.stamp) >= kProbation;
  track = seen ? std::make_optional<StandingTrack>(filter, *seen, frame.stamp) : std::nullopt;
  return false;
}

void TrackStatus::noteUse(Stamp frame) {
  last_used_ = frame;
  skipped_.clear();
}

void TrackStatus::clear() {
  rejected_.clear();
  suspects_.clear();
  skipped_.clear();
}

bool TrackStatus::believesMap(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                              const Associations& seen, std::optional<Stamp> last_frame) {
  if (!last_used_ || !last_frame) return false;
  const auto begun = std::count_if(seen.unknown.begin(), seen.unknown.end(), [&](std::size_t feature) {
    return skipped_.count(frame.features[feature].id) == 0;
  });
  if (static_cast<std::size_t>(begun) > seen.known.size()) return false;
  const bool is_other = isAnotherView(filter, model, frame, seen);
  const double contradicted = secondsBetween(*last_used_, frame.stamp);
  return *last_used_ == *last_frame || contradicted < kBadFrames || (contradicted < kTrusted && !is_other);
}

/// Whether most tracks are seen where earlier frames that were skipped saw them.
bool TrackStatus::isAnotherView(const Filter& filter, const StereoModel& model, const StereoFrame& frame,
                                const Associations& seen) {
  std::size_t same = 0, all = 0;
  const auto look = [&](std::size_t i) {
    const StereoFeatureObservation& feature = frame.features[i];
    const auto now = model.triangulate(filter, feature.pixels, feature.sigma);
    if (!now) return;
    const auto before = skipped_.find(feature.id);
    if (before != skipped_.end()) ++all;
    if (before != skipped_.end() && before->second.distanceTo(filter, *now) < kSameView)
      ++same;
    else
      skipped_.insert_or_assign(feature.id, StandingTrack(filter, *now, frame.stamp));
  };
  for (const Association& known : seen.known) look(known.feature);
  for (const std::size_t feature : seen.unknown) look(feature);
  return same > 0 && static_cast<double>(same) > kMostOfView * static_cast<double>(all);
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/loops/place_loops.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/loops/place_recogniser.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kBetween = 2.0; // s between attempts, each of which may take some 0.1 s
constexpr std::size_t kObservationsNow = 5;
constexpr double kRadius = 70.0; // m about the vehicle
// How often the view may have changed for a landmark to be of now, and must have for it to be of before.
constexpr std::uint64_t kRecentViews = 3, kOldViews = 15;
constexpr std::size_t kLeastBefore = 40;   // landmarks, for a place to be recognised
constexpr std::size_t kLeastAgreeing = 10; // matches that the filter itself must find compatible
constexpr double kWayBetween = 5.0;        // m, between two attempts that confirm each other
constexpr double kNearPoint = 0.3; // m: a corner found anew is not the corner found before, but near it

} // namespace

PlaceLoops::PlaceLoops() : agreement_(2, kLeastAgreeing) {}

Revisit PlaceLoops::update(Filter& filter, LandmarkMap& map, Stamp now, Settling& settling) {
  if (!confirmed_.empty()) return settling.isReady(filter, now) ? close(filter, map) : Revisit();
  if ((next_attempt_ && now < *next_attempt_) || map.inactiveCount() < kLeastBefore) return {};
  next_attempt_ = now + fromSeconds(kBetween);
  const std::uint64_t view = map.keptOfView();
  const Eigen::Vector3d about = filter.pose().translation();
  const Matrix6d covariance = filter.covariance().topLeftCorner<6, 6>();
  const double reach = kRadius + 3.0 * std::sqrt(covariance.diagonal().head<3>().maxCoeff());
  std::vector<PlacePoint> seen_now, seen_before;
  const auto active = map.indexById();
  map.forEachOutOfView(filter, [&](const Landmark& landmark, const InactiveStore::Estimate& estimate) {
    const FeatureId id = landmark.id;
    if (active.count(id)) return; // its id has returned: ReturningLandmarks'
    const std::uint64_t since = filter.inactive().deactivatedSince(landmark.variable);
    const Eigen::Vector3d position = estimate.variable.mean;
    const double distance = (position - about).norm();
    if (since > kOldViews * view && distance < reach) seen_before.push_back({id, position});
    if (since <= kRecentViews * view && distance < kRadius) seen_now.push_back({id, position});
  });
  if (seen_before.size() < kLeastBefore) return {};
  for (const Landmark& l : map.active()) {
    const Eigen::Vector3d position = filter.variables().point(l.variable);
    if (l.observations >= kObservationsNow && (position - about).norm() < kRadius)
      seen_now.push_back({l.id, position});
  }
  const auto recognition = recognisePlace(seen_now, seen_before, about, covariance);
  if (!recognition) return {};
  const bool is_ready = settling.isReady(filter, now); // or will be when the place is confirmed
  if (!agreement_.confirms(*recognition, about, kWayBetween)) return {};
  agreement_.restart();
  confirmed_ = recognition->matches;
  return is_ready ? close(filter, map) : Revisit();
}

/// What was confirmed, as far as it is still in the map.
Revisit PlaceLoops::close(Filter& filter, LandmarkMap& map) {
  Matches matches = std::exchange(confirmed_, {});
  const auto active = map.indexById();
  const auto is_gone = [&](FeatureId id) { return !map.isInactive(id) && !active.count(id); };
  matches.erase(std::remove_if(matches.begin(), matches.end(),
                               [&](const auto& m) { return is_gone(m.first) || !map.isInactive(m.second); }),
                matches.end());
  if (matches.size() < kLeastAgreeing) return {};
  std::vector<FeatureId> ids;
  const FeatureId middle = matches[matches.size() / 2].second;
  const Stamp last_seen = map.inactive(map.inactiveVariable(middle)).last_seen;
  for (const auto& [is_now, was] : matches) {
    if (map.isInactive(is_now)) ids.push_back(is_now);
    ids.push_back(was);
  }
  const std::size_t first = map.active().size();
  map.reactivate(filter, ids);
  const auto index = map.indexById();
  std::vector<Duplicate> pairs;
  for (const auto& [is_now, was] : matches)
    pairs.push_back({map.active()[index.at(is_now)].variable, map.active()[index.at(was)].variable});
  const std::size_t fused = countTrue(fuseDuplicates(filter, pairs, kLeastAgreeing, kNearPoint));
  for (std::size_t i = map.active().size(); i-- > first;) map.deactivate(filter, i);
  return {fused, last_seen};
}

} // namespace vi_ekf_slam

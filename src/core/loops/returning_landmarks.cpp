#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace vi_ekf_slam {
namespace {

// Before a landmark is compared with what was seen of it before: observations, and the standard deviation of
// its distance, up to which its error is one of straight coordinates. Of a far one the pixels tell the
// inverse of the distance: a dozen of them, new and each a little wrong to the same side, would move the pose
// with them.
constexpr std::size_t kObservations = 3;
constexpr double kDistanceSigma = 0.1; // of the distance
// They must agree with each other, so that wrong ids do no harm.
constexpr std::size_t kLeast = 3, kMost = 100;
constexpr double kSamePoint = 1e-3; // m, how far apart a landmark may be from itself: rounding
// Landmarks of the map that should come into view.
constexpr double kExpectedDistance = 50.0; // m
constexpr double kBetweenLooksAhead = 1.0; // s

bool isLocated(const Filter& filter, const Landmark& landmark) {
  const Eigen::Vector3d way = filter.variables().point(landmark.variable) - filter.pose().translation();
  const double distance2 = way.squaredNorm();
  const double variance = way.dot(filter.covariance(landmark.variable) * way) / distance2;
  return variance < kDistanceSigma * kDistanceSigma * distance2;
}

/// The view has changed altogether since. One that was away for a moment has nothing to tell.
bool isLongOutOfView(const Filter& filter, const LandmarkMap& map, FeatureId inactive) {
  return filter.inactive().deactivatedSince(map.inactiveVariable(inactive)) > map.active().size();
}

} // namespace

void lookAhead(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now, Settling& settling) {
  if (secondsBetween(map.expectedSince(), now) < kBetweenLooksAhead) return;
  const auto is_known = [now](const Landmark& l) { return l.in_map && l.last_seen == now; };
  const auto known = std::count_if(map.active().begin(), map.active().end(), is_known);
  if (static_cast<std::size_t>(known) < kLeast) return;
  const SE3 cam_T_world = model.camTWorld(filter);
  std::vector<FeatureId> ids;
  map.forEachOutOfView(filter, [&](const LandmarkMap::OutOfView& l) {
    const Eigen::Vector3d q = cam_T_world * Eigen::Vector3d(l.estimate.variable.mean);
    if (q.z() > 0.0 && q.norm() < kExpectedDistance && isLongOutOfView(filter, map, l.landmark.id))
      ids.push_back(l.landmark.id);
  });
  if (!ids.empty()) settling.isReady(filter, now);
  map.expect(std::move(ids), now);
}

void ReturningLandmarks::recognise(Filter& filter, LandmarkMap& map, const StereoFrame& frame,
                                   const std::vector<std::size_t>& usable) {
  const std::vector<FeatureId> expected = map.expected(frame.stamp);
  if (expected.empty()) return;
  std::unordered_set<FeatureId> in_view;
  for (const std::size_t feature : usable) in_view.insert(frame.features[feature].id);
  std::vector<FeatureId> again;
  std::copy_if(expected.begin(), expected.end(), std::back_inserter(again),
               [&in_view](FeatureId id) { return in_view.count(id) != 0; });
  map.reactivate(filter, again);
}

Revisit ReturningLandmarks::update(Filter& filter, LandmarkMap& map, Stamp now, Settling& settling) {
  if (filter.inactive().isEmpty()) return {};
  std::vector<FeatureId> ids;
  std::unordered_set<FeatureId> in_view;
  for (const Landmark& landmark : map.active()) {
    if (elsewhere_.count(landmark.id)) in_view.insert(landmark.id);
    if (ids.size() < kMost && landmark.observations >= kObservations && map.isInactive(landmark.id) &&
        !elsewhere_.count(landmark.id) && isLongOutOfView(filter, map, landmark.id) &&
        isLocated(filter, landmark))
      ids.push_back(landmark.id);
  }
  elsewhere_.swap(in_view);
  if (ids.size() < kLeast || !settling.isReady(filter, now)) return {};
  return fuse(filter, map, ids, kLeast);
}

Revisit ReturningLandmarks::fuse(Filter& filter, LandmarkMap& map, const std::vector<FeatureId>& ids,
                                 std::size_t least) {
  Matches matches;
  for (const FeatureId id : ids) matches.emplace_back(id, id);
  const auto [fusion, revisit] = fuseMatches(filter, map, matches, least, kSamePoint);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (!fusion.fused[i]) elsewhere_.insert(ids[i]);
  }
  return revisit;
}

} // namespace vi_ekf_slam

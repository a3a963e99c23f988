#include "vi_ekf_slam/core/map/returning_landmarks.hpp"

#include <algorithm>

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
// Landmarks of the map that are made active because they should come into view.
constexpr std::size_t kMostExpected = 60;
constexpr double kExpectedDistance = 50.0; // m
constexpr double kExpectedTime = 10.0;     // s without an observation

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

std::vector<FeatureId> soonInView(const Filter& filter, const LandmarkMap& map, const StereoModel& model) {
  const SE3 cam_T_world = model.camTWorld(filter);
  std::vector<std::pair<double, FeatureId>> near;
  map.forEachOutOfView(filter, [&](const LandmarkMap::OutOfView& l) {
    const Eigen::Vector3d q = cam_T_world * Eigen::Vector3d(l.estimate.variable.mean);
    if (q.z() > 0.0 && q.norm() < kExpectedDistance && isLongOutOfView(filter, map, l.landmark.id))
      near.emplace_back(q.norm(), l.landmark.id);
  });
  std::sort(near.begin(), near.end());
  near.resize(std::min(near.size(), kMostExpected));
  std::vector<FeatureId> ids;
  for (const auto& [distance, id] : near) ids.push_back(id);
  return ids;
}

bool ReturningLandmarks::isExpected(const Landmark& landmark, const Filter& filter, const StereoModel& model,
                                    Stamp now) {
  return landmark.reactivated && secondsBetween(landmark.last_seen, now) < kExpectedTime &&
         (model.camTWorld(filter) * filter.variables().point(landmark.variable)).z() > 0.0;
}

Revisit ReturningLandmarks::update(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now,
                                   SettlingAllowance& allowance) {
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
  if (ids.size() < kLeast || !allowance.suffices()) return {};
  allowance.spend();
  return fuse(filter, map, model, now, ids, kLeast);
}

Revisit ReturningLandmarks::fuse(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now,
                                 const std::vector<FeatureId>& ids, std::size_t least) {
  const auto index = map.indexById();
  Matches matches;
  for (const FeatureId id : ids) matches.emplace_back(id, id);
  std::vector<FeatureId> expected;
  for (const FeatureId id : soonInView(filter, map, model)) {
    if (!index.count(id)) expected.push_back(id);
  }
  const auto [fusion, revisit] = fuseMatches(filter, map, matches, expected, now, least, kSamePoint);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (!fusion.fused[i]) elsewhere_.insert(ids[i]);
  }
  return revisit;
}

} // namespace vi_ekf_slam

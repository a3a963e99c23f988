#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/loops/appearance_index.hpp"

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
// Standard deviations of the place in the picture where a landmark should be seen, of the focal length.
// Farther off the projection is not linear.
constexpr double kLinear = 0.1;
// 14 px with a focal length of 720 px: of a hundred features some other one lies within that gate by chance.
constexpr double kDistinct = 0.02;
constexpr std::size_t kAgreeing = 3; // claims that are believed where nothing else judges them

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

/// A feature of a new track as an observation of a landmark that is expected.
struct Claim {
  std::size_t landmark; ///< index in the map's active ones
  FeatureId id;         ///< of the feature
  LinearMeasurement seen;
  bool is_distinct;
};

/// Of those that are expected the ones that any of the looks may be, active now.
void reactivateAlike(Filter& filter, LandmarkMap& map, const std::vector<DescriptorSet>& looks, Stamp now) {
  std::vector<FeatureId> alike;
  for (const FeatureId id : map.expected(now)) {
    const DescriptorSet& known = map.inactive(map.inactiveVariable(id)).descriptors;
    const auto is_alike = [&known](const DescriptorSet& look) {
      return distance(look, known) <= MostAlike::kMostBits;
    };
    if (std::any_of(looks.begin(), looks.end(), is_alike)) alike.push_back(id);
  }
  map.reactivate(filter, alike);
}

std::vector<Claim> claimsOf(const Filter& filter, const LandmarkMap& map, const StereoModel& model,
                            const std::vector<const StereoFeatureObservation*>& features,
                            const std::vector<DescriptorSet>& looks) {
  std::vector<std::size_t> expected;
  for (std::size_t i = 0; i < map.active().size(); ++i) {
    if (map.active()[i].reactivated && !map.active()[i].descriptors.isEmpty()) expected.push_back(i);
  }
  const double focal2 = std::pow(model.rig().camera.fu, 2);
  std::vector<Claim> claims;
  for (std::size_t k = 0; k < features.size() && !expected.empty(); ++k) {
    const StereoFeatureObservation& f = *features[k];
    const double corner = kCornerSigma * (f.pixels[0] - f.pixels[2]) / model.rig().camera.baseline; // px
    const double sigma = std::hypot(model.sigmaOf(f.sigma), corner);
    MostAlike best;
    std::optional<Claim> claim;
    for (const std::size_t i : expected) {
      const Landmark& landmark = map.active()[i];
      const int bits = distance(looks[k], landmark.descriptors);
      if (bits > MostAlike::kMostBits) continue;
      const auto seen = model.observe(filter, landmark.variable, f.pixels, sigma);
      if (!seen) continue;
      const Innovation in(filter.covariance(), {*seen});
      const double variance = in.S(0, 0).diagonal().maxCoeff();
      if (!(in.nisOf(0) < kChiSquare3 && variance < kLinear * kLinear * focal2)) continue;
      best.offer(i, bits, [&] {
        const Handle a = landmark.variable, b = map.active()[best.first].variable;
        return mayBeSame(filter.variables().point(a) - filter.variables().point(b),
                         filter.covariance(a) + filter.covariance(b));
      });
      if (best.first == i) claim = Claim{i, f.id, *seen, variance < kDistinct * kDistinct * focal2};
    }
    if (!best.isClear()) continue;
    claims.push_back(*claim);
    expected.erase(std::find(expected.begin(), expected.end(), best.first));
  }
  return claims;
}

} // namespace

void lookAhead(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now, Settling& settling) {
  if (secondsBetween(map.expectedSince(), now) < kBetweenLooksAhead) return;
  const auto is_known = [now](const Landmark& l) { return l.in_map && l.last_seen == now; };
  const auto known = std::count_if(map.active().begin(), map.active().end(), is_known);
  if (static_cast<std::size_t>(known) < kLeast) return;
  const SE3 cam_T_world = model.camTWorld(filter);
  std::vector<FeatureId> ids;
  map.forEachOutOfView(filter, [&](const Landmark& landmark, const InactiveStore::Estimate& estimate) {
    const Eigen::Vector3d q = cam_T_world * Eigen::Vector3d(estimate.variable.mean);
    if (q.z() > 0.0 && q.norm() < kExpectedDistance && isLongOutOfView(filter, map, landmark.id))
      ids.push_back(landmark.id);
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

void claimExpected(Filter& filter, LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
                   const std::vector<std::size_t>& usable) {
  const auto tracked = map.indexById();
  std::vector<const StereoFeatureObservation*> features;
  std::vector<DescriptorSet> looks;
  bool any_tracked = false;
  for (const std::size_t feature : usable) {
    const StereoFeatureObservation& f = frame.features[feature];
    any_tracked = any_tracked || tracked.count(f.id);
    if (!f.descriptor || tracked.count(f.id) || map.isInactive(f.id)) continue;
    features.push_back(&f);
    looks.emplace_back().add(*f.descriptor);
  }
  reactivateAlike(filter, map, looks, frame.stamp);
  const std::vector<Claim> claims = claimsOf(filter, map, model, features, looks);
  if (claims.empty()) return;
  std::vector<LinearMeasurement> seen;
  for (const Claim& claim : claims) seen.push_back(claim.seen);
  const std::vector<bool> agrees = largestAgreement(Innovation(filter.covariance(), std::move(seen)));
  const bool agree = countTrue(agrees) >= kAgreeing;
  for (std::size_t k = 0; k < claims.size(); ++k) {
    if (agree ? !agrees[k] : !(claims[k].is_distinct && any_tracked)) continue;
    Landmark& landmark = map.active(claims[k].landmark);
    landmark.id = claims[k].id;
    // It is the point of this track from now on.
    filter.addNoise(filter.rowOf(landmark.variable), isotropic(kCornerSigma));
  }
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
  const Revisit revisit = fuseMatches(filter, map, matches, least, kSamePoint);
  std::copy_if(ids.begin(), ids.end(), std::inserter(elsewhere_, elsewhere_.end()),
               [&map](FeatureId id) { return map.isInactive(id); }); // not fused
  return revisit;
}

} // namespace vi_ekf_slam

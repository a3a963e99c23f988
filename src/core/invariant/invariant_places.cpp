// How InvariantEstimator closes loops where ids do not return.

#include <cmath>

#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/invariant/place_recogniser.hpp"
#include "vi_ekf_slam/core/invariant/twin_fusion.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr int kFramesBetween = 20; // attempts, each of which may take some 0.1 s
constexpr std::size_t kPlaceObservations = 5;
constexpr double kRadius = 70.0; // m about the vehicle
// How often the view may have changed for a landmark to be of now, and must have for it to be of before.
constexpr std::uint64_t kViewsNow = 3, kViewsBefore = 15;
constexpr std::size_t kLeastBefore = 40;   // landmarks, for a place to be recognised
constexpr std::size_t kLeastAgreeing = 10; // matches that the state itself must find compatible
// m: a corner found anew is not the corner found before, but near it.
constexpr double kNearPoint = 0.3;

} // namespace

/// What was seen lately is compared with what was seen long ago in reach of the present uncertainty. A match
/// is told to the state as two points that are near each other; both remain.
void InvariantEstimator::recognisePlace(FrameReport& report) {
  if (!config_.map.recognise_places || --frames_until_recognition_ > 0) return;
  const std::uint64_t view = state_.landmarks().size();
  if (state_.inactive().size() < kLeastBefore ||
      settling_allowance_ < state_.inactive().settlingCost(state_.size()))
    return;
  frames_until_recognition_ = kFramesBetween;

  const Eigen::Vector3d about = state_.pose().translation();
  const Matrix6d covariance = poseCovariance();
  const double reach = kRadius + 3.0 * std::sqrt(covariance.diagonal().head<3>().maxCoeff());
  std::vector<PlacePoint> now, before;
  const PooledHashMap<FeatureId, std::size_t> active = state_.indexById();
  for (const InactiveLandmark& inactive : state_.inactiveLandmarks(InactiveMap::Covariances::kLastSettled)) {
    const Landmark& l = inactive.landmark;
    if (active.count(l.id)) continue; // its id has returned: revisit's
    const std::uint64_t since = state_.inactive().departuresSince(l.id);
    const double distance = (l.position - about).norm();
    if (since > kViewsBefore * view && distance < reach) before.push_back({l.id, l.position});
    if (since <= kViewsNow * view && distance < kRadius) now.push_back({l.id, l.position});
  }
  if (before.size() < kLeastBefore) return;
  for (const Landmark& l : state_.landmarks()) {
    if (l.observations >= kPlaceObservations && (l.position - about).norm() < kRadius)
      now.push_back({l.id, l.position});
  }
  const auto recognition = PlaceRecogniser().recognise(now, before, about, covariance);
  if (!recognition) return;

  settling_allowance_ = 0.0;
  std::vector<FeatureId> ids;
  for (const auto& [seen_now, seen_before] : recognition->matches) {
    if (state_.inactive().contains(seen_now)) ids.push_back(seen_now);
    ids.push_back(seen_before);
  }
  const std::size_t first = state_.landmarks().size();
  state_.activateLandmarks(ids);
  const PooledHashMap<FeatureId, std::size_t> index = state_.indexById();
  std::vector<Twin> twins;
  for (const auto& [seen_now, seen_before] : recognition->matches)
    twins.push_back({index.at(seen_now), index.at(seen_before)});
  const TwinFusion fusion = fuseTwins(state_, twins, kLeastAgreeing, kNearPoint);
  report.place_recognised = fusion.dof > 0;
  for (std::size_t i = state_.landmarks().size(); i-- > first;) state_.deactivateLandmark(i);
}

} // namespace vi_ekf_slam::invariant

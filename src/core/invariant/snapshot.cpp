// How InvariantEstimator's estimate goes out as a saved map, and comes back.

#include <algorithm>
#include <unordered_set>
#include <utility>

#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/invariant/saved_joint.hpp"

namespace vi_ekf_slam::invariant {
namespace {

constexpr std::size_t kKeptObservations = 3; // of a landmark in view, to be worth keeping
// rad, standard deviation after the gap: corrections of more are none that are linear.
constexpr double kKnownRotation = 1.0;
constexpr double kRounding = 1e-12; // of the largest variance

/// `slides`: what the tracks of the active landmarks have displaced them by.
SavedMap savedFrom(State& state, Stamp stamp, const std::vector<Eigen::Matrix3d>& slides) {
  std::vector<std::size_t> active;
  std::unordered_set<FeatureId> ids;
  for (std::size_t i = 0; i < state.landmarks().size(); ++i) {
    const Landmark& l = state.landmarks()[i];
    // Of one that is seen again but not yet fused, the map's estimate is the one that stays.
    if (l.observations >= kKeptObservations && !state.inactive().contains(l.id) && ids.insert(l.id).second)
      active.push_back(i);
  }
  if (active.size() > kMaxSavedLandmarks) active.resize(kMaxSavedLandmarks);
  const std::size_t room = kMaxSavedLandmarks - active.size();
  if (state.inactive().size() > room) state.marginaliseOldest(state.inactive().size() - room);
  State::Joint joint = state.joint(active);
  const std::size_t inactive = joint.landmarks.size() - active.size();
  for (std::size_t i = 0; i < active.size(); ++i) {
    const Eigen::Index row = State::offsetOf(inactive + i);
    joint.covariance.block<3, 3>(row, row) += slides[active[i]];
  }
  SavedMap map{stamp, state.pose(), state.twist(), state.bias(), {}, std::move(joint.covariance)};
  for (const Landmark& l : joint.landmarks) map.landmarks.push_back({l.id, l.position, l.observations});
  return map;
}

} // namespace

State::Joint jointOf(const SavedMap& map) {
  State::Joint joint{{}, map.covariance};
  double farthest2 = map.world_T_imu.translation().squaredNorm();
  for (const SavedLandmark& l : map.landmarks) {
    joint.landmarks.push_back({l.id, l.position, l.observations});
    farthest2 = std::max(farthest2, l.position.squaredNorm());
  }
  auto variances = joint.covariance.diagonal();
  // Errors about the origin: what turns there shifts what is far away.
  const double largest = variances.maxCoeff() + farthest2 * variances.segment<3>(kRotation).maxCoeff();
  variances.segment<3>(kPosition).array() += kRounding * largest;
  variances.tail(variances.size() - kLandmarks).array() += kRounding * largest;
  return joint;
}

/// With the drift that the next frame would account for.
std::function<SavedMap()> InvariantEstimator::savedMap() const {
  if (!keepsJointMap() || !stamp_) return {};
  State copy = state_;
  copy.loosen(Drift(drift_).take());
  std::vector<Eigen::Matrix3d> slides;
  for (const Landmark& landmark : copy.landmarks()) slides.push_back(slideOf(landmark));
  return [state = std::move(copy), stamp = *stamp_, slides = std::move(slides)]() mutable {
    return savedFrom(state, stamp, slides);
  };
}

void InvariantEstimator::resumeFrom(std::shared_ptr<const SavedMap> map, double max_gap_s) {
  resumed_ = std::move(map);
  max_gap_s_ = max_gap_s;
  map_use_ = MapUse::kWaiting;
}

/// What was in view is out of view now, like the rest: tracks that go on begin as new landmarks and are fused
/// with it.
void InvariantEstimator::resume(Stamp stamp) {
  const std::shared_ptr<const SavedMap> map = std::exchange(resumed_, nullptr);
  const double gap = secondsBetween(map->stamp, stamp);
  if (gap >= 0.0 && gap <= max_gap_s_) {
    State restored = state_;
    restored.restore(map->world_T_imu, map->twist, map->bias, jointOf(*map));
    State ahead = restored;
    ahead.propagate(gap, {config_.twist_density, config_.bias_density});
    const double rotation = ahead.covariance().diagonal().segment<3>(kRotation).maxCoeff();
    std::swap(state_, restored);
    if (rotation <= kKnownRotation * kKnownRotation && isSound(true)) {
      stamp_ = map->stamp;
      gyro_graded_ = velocity_graded_ =
          true; // the bias is an estimate, not what a sensor is given beforehand
      rotation_variance_ = state_.poseCovariance().diagonal().tail<3>();
      keepSound(true);
      map_use_ = MapUse::kResumed;
      return;
    }
    std::swap(state_, restored);
  }
  relocaliseIn(map);
}

} // namespace vi_ekf_slam::invariant

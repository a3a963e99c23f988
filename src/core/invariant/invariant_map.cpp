// What InvariantEstimator does with landmarks out of view.

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/core/invariant/invariant_estimator.hpp"
#include "vi_ekf_slam/core/invariant/twin_fusion.hpp"

namespace vi_ekf_slam::invariant {
namespace {

// Operations a frame may spend on the average to settle the map: some 10 ms.
constexpr double kSettlingPerFrame = 2e8;
constexpr double kMostComposed = 1e9;            // of them in one frame
constexpr std::size_t kArchivedObservations = 3; // of a landmark, for its last estimate to stay in the map
// Before a landmark is compared with what was seen of it before: observations, and the standard deviation of
// its distance, up to which its error is one of straight coordinates.
constexpr std::size_t kTwinObservations = 3;
constexpr double kTwinDistance = 0.1; // of the distance
// Twins must agree with each other, so that wrong ids do no harm.
constexpr std::size_t kLeastTwins = 3, kMostTwins = 100;
constexpr double kMostSaved = 100.0;     // frames
constexpr std::size_t kViewsLongAgo = 5; // changes of the view, not a frame that was lost
constexpr double kSamePoint = 1e-3;      // m, how far apart a landmark may be from itself: rounding
// Landmarks of the map that are made active because they should come into view.
constexpr std::size_t kMostRecalled = 60;
constexpr double kRecallDistance = 50.0; // m
constexpr int kRecallFrames = 100;       // without an observation

LandmarkEstimate estimateOf(const InactiveLandmark& l) {
  return {l.landmark.id, l.landmark.position, l.covariance};
}

} // namespace

void InvariantEstimator::remove(const PooledVector<bool>& keep, FrameReport& report) {
  for (std::size_t i = keep.size(); i-- > 0;) {
    if (keep[i]) continue;
    retire(i);
    ++report.removed;
  }
}

/// The landmark leaves the active state, for where the configuration wants it.
void InvariantEstimator::retire(std::size_t landmark) {
  const Landmark& l = state_.landmarks()[landmark];
  disputed_.erase(l.id);
  const bool good = l.observations >= config_.map.min_observations;
  const bool known = l.observations >= kArchivedObservations;
  if (state_.keepsInactive() && state_.inactive().contains(l.id)) {
    state_.removeLandmark(landmark); // the map has it, from before
  } else if (state_.keepsInactive() && (good || config_.map.keep == MapKeep::kAll)) {
    state_.deactivateLandmark(landmark, slideOf(l));
  } else {
    if (known) archive_.put(estimateOf(landmark));
    state_.removeLandmark(landmark);
  }
}

/// What drift the point has taken on while it was tracked, covariance along the world axes, m^2: it was seen
/// where it is when its track began, and has moved with all other tracks since. That is not independent from
/// one landmark to the next, but each began at another time; without it, one that returns would tell where
/// the pose was when it left, and not when it came.
Eigen::Matrix3d InvariantEstimator::slideOf(const Landmark& landmark) const {
  Drift slide(config_.drift_position, config_.drift_rotation);
  if (!landmark.anchored) slide.drive(state_.pose().translation(), driven_ - landmark.tracked_since);
  return slide.ofPoint(landmark.position);
}

/// A batch at a time, since means must be brought up to date.
void InvariantEstimator::boundInactive() {
  const std::size_t most = config_.map.max_landmarks, held = state_.inactive().size();
  if (held <= most) return;
  for (const InactiveLandmark& gone : state_.marginaliseOldest(held - most + most / 4)) {
    if (gone.landmark.observations >= kArchivedObservations) archive_.put(invariant::estimateOf(gone));
  }
}

/// Their last estimates stay in the map, where they are sound.
void InvariantEstimator::archiveInactive() {
  for (const InactiveLandmark& l : state_.inactiveLandmarks(InactiveMap::Covariances::kLastSettled)) {
    if (l.landmark.position.allFinite() && l.covariance.allFinite() &&
        (l.covariance.diagonal().array() >= 0.0).all())
      archive_.put(invariant::estimateOf(l));
  }
}

/// Landmarks that were recalled stay active, if they are not in view yet, while they are before the camera.
void InvariantEstimator::keepRecalled(const StereoFrame& frame, const PooledVector<std::size_t>& unknown,
                                      PooledVector<bool>& keep, FrameReport& report) {
  const SE3 cam_T_world = model_->rig().cam_T_imu * state_.pose().inverse();
  for (std::size_t i = 0; i < keep.size(); ++i) {
    const Landmark& l = state_.landmarks()[i];
    const auto recalled = recalled_.find(l.id);
    if (recalled == recalled_.end()) continue;
    if (keep[i]) {
      ++report.revisited;
      loop_closed_ = true;
      state_.beginTrack(i, driven_);
      recalled_.erase(recalled);
      continue;
    }
    const bool begins_anew = std::any_of(unknown.begin(), unknown.end(), [&](std::size_t feature) {
      return frame.features[feature].id == l.id;
    });
    keep[i] = !begins_anew && !outcasts_.count(l.id) && --recalled->second > 0 &&
              (cam_T_world * l.position).z() > 0.0;
    if (!keep[i]) recalled_.erase(recalled);
  }
}

/// Inactive landmarks before the camera, the nearest first, that have been out of view for some time.
std::vector<FeatureId> InvariantEstimator::soonInView() const {
  const SE3 cam_T_world = model_->rig().cam_T_imu * state_.pose().inverse();
  std::vector<std::pair<double, FeatureId>> near;
  for (const InactiveLandmark& inactive : state_.inactiveLandmarks(InactiveMap::Covariances::kLastSettled)) {
    const Eigen::Vector3d q = cam_T_world * inactive.landmark.position;
    if (q.z() > 0.0 && q.norm() < kRecallDistance && isLongOutOfView(inactive.landmark.id))
      near.emplace_back(q.norm(), inactive.landmark.id);
  }
  std::sort(near.begin(), near.end());
  near.resize(std::min(near.size(), kMostRecalled));
  std::vector<FeatureId> ids;
  for (const auto& [distance, id] : near) ids.push_back(id);
  return ids;
}

/// The view has changed altogether since. One that was away for a moment has nothing to tell.
bool InvariantEstimator::isLongOutOfView(FeatureId inactive) const {
  return state_.inactive().departuresSince(inactive) > state_.landmarks().size();
}

/// How far away the landmark is, is known well enough for it to be compared with a point. Of a far one the
/// pixels tell the inverse of the distance: a dozen of them, new and each a little wrong to the same side,
/// would move the pose with them.
bool InvariantEstimator::isLocated(std::size_t landmark) const {
  const Eigen::Vector3d way = state_.landmarks()[landmark].position - state_.pose().translation();
  const double distance2 = way.squaredNorm();
  const double variance = way.dot(state_.relativeCovariance(State::offsetOf(landmark)) * way) / distance2;
  return variance < kTwinDistance * kTwinDistance * distance2;
}

/// An id that returns begins as a new landmark, so that the drive goes on as if it were one. When some have
/// been seen often enough, and settling the map has been saved up for, they are fused with what was seen of
/// them before; and what should come into view next is made active, to be recognised at once.
void InvariantEstimator::revisit(FrameReport& report) {
  const auto cost = [this] { return state_.inactive().settlingCost(state_.size()); };
  settling_allowance_ =
      std::min(settling_allowance_ + kSettlingPerFrame, std::max(cost(), kMostSaved * kSettlingPerFrame));
  std::vector<FeatureId> ids;
  for (std::size_t i = 0; i < state_.landmarks().size() && ids.size() < kMostTwins; ++i) {
    const Landmark& landmark = state_.landmarks()[i];
    if (landmark.observations >= kTwinObservations && state_.inactive().contains(landmark.id) &&
        !disputed_.count(landmark.id) && isLongOutOfView(landmark.id) && isLocated(i))
      ids.push_back(landmark.id);
  }
  if (ids.size() < kLeastTwins) return;
  // Frame by frame, so that none takes long.
  settling_allowance_ -= state_.compose(std::min(settling_allowance_, kMostComposed));
  const double left = cost();
  if (settling_allowance_ < left) return;
  settling_allowance_ -= left;
  report.revisited += fuseReturned(std::move(ids), kLeastTwins);
}

/// Fuses the active landmarks of these ids with the inactive ones, where at least `least` of them agree. How
/// many were.
std::size_t InvariantEstimator::fuseReturned(std::vector<FeatureId> ids, std::size_t least) {
  const PooledHashMap<FeatureId, std::size_t> now = state_.indexById();
  const std::size_t first = state_.landmarks().size();
  const bool long_ago = std::any_of(ids.begin(), ids.end(), [&](FeatureId id) {
    return state_.inactive().departuresSince(id) > kViewsLongAgo * first;
  });
  std::vector<Twin> twins;
  for (std::size_t i = 0; i < ids.size(); ++i) twins.push_back({now.at(ids[i]), first + i});
  for (const FeatureId id : soonInView()) {
    if (!now.count(id)) ids.push_back(id);
  }
  state_.activateLandmarks(ids);
  const TwinFusion fusion = fuseTwins(state_, twins, least, kSamePoint);
  const bool recognised = fusion.dof > 0;
  if (recognised && long_ago) loop_closed_ = true;
  for (std::size_t i = ids.size(); i-- > twins.size();) {
    if (recognised) {
      recalled_[ids[i]] = kRecallFrames;
    } else {
      state_.deactivateLandmark(first + i);
    }
  }
  std::size_t fused = 0;
  // From behind: whoever takes a place comes from behind it.
  for (std::size_t i = twins.size(); i-- > 0;) {
    if (fusion.fused[i]) {
      state_.addObservations(twins[i].now, state_.landmarks()[twins[i].before].observations);
      state_.removeLandmark(twins[i].before);
      ++fused;
    } else {
      state_.deactivateLandmark(twins[i].before);
      disputed_.insert(ids[i]);
    }
  }
  return fused;
}

LandmarkEstimate InvariantEstimator::estimateOf(std::size_t landmark) const {
  const Landmark& l = state_.landmarks()[landmark];
  return {l.id, l.position, state_.landmarkCovariance(landmark) + drift_.ofPoint(l.position)};
}

std::vector<LandmarkEstimate> InvariantEstimator::landmarks() const {
  return landmarks(InactiveMap::Covariances::kLastSettled);
}

/// Of a copy: what is large in it is shared.
std::function<std::vector<LandmarkEstimate>()> InvariantEstimator::exactMap() const {
  return [copy = *this] { return copy.landmarks(InactiveMap::Covariances::kExact); };
}

std::vector<LandmarkEstimate> InvariantEstimator::landmarks(InactiveMap::Covariances covariances) const {
  // Of several estimates of one landmark the first one stays: of one that is seen again but not yet fused the
  // map's.
  std::vector<LandmarkEstimate> all;
  all.reserve(archive_.landmarks().size() + state_.landmarks().size() +
              (state_.keepsInactive() ? state_.inactive().size() : 0));
  for (const InactiveLandmark& inactive : state_.inactiveLandmarks(covariances))
    all.push_back(invariant::estimateOf(inactive));
  for (std::size_t i = 0; i < state_.landmarks().size(); ++i) all.push_back(estimateOf(i));
  for (const auto& [id, landmark] : archive_.landmarks()) all.push_back(landmark);
  std::stable_sort(all.begin(), all.end(),
                   [](const LandmarkEstimate& a, const LandmarkEstimate& b) { return a.id < b.id; });
  all.erase(std::unique(all.begin(), all.end(),
                        [](const LandmarkEstimate& a, const LandmarkEstimate& b) { return a.id == b.id; }),
            all.end());
  return all;
}

} // namespace vi_ekf_slam::invariant

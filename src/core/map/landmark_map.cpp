#include "vi_ekf_slam/core/map/landmark_map.hpp"

#include <algorithm>
#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kMaxArchived = 100000;     // landmarks
constexpr std::size_t kArchivedObservations = 3; // of a landmark, for its last estimate to stay in the map
constexpr double kExpectedTime = 10.0;           // s
constexpr std::size_t kMostOthers = 1000;        // inactive variables that are no landmarks, by default

} // namespace

LandmarkMap::LandmarkMap(const Options& options) : options_(options), archive_(kMaxArchived) {}

std::unordered_map<FeatureId, std::size_t> LandmarkMap::indexById() const {
  std::unordered_map<FeatureId, std::size_t> index(active_.size());
  for (std::size_t i = 0; i < active_.size(); ++i) index.emplace(active_[i].id, i);
  return index;
}

void LandmarkMap::drop(std::size_t index) {
  active_[index] = active_.back();
  active_.pop_back();
}

void LandmarkMap::putInactive(Landmark landmark) {
  landmark.reactivated = false;
  landmark.in_map = true;
  inactive_by_id_[landmark.id] = landmark.variable;
  inactive_[landmark.variable] = landmark;
}

Landmark LandmarkMap::takeInactive(Handle variable) {
  const Landmark landmark = inactive_.extract(variable).mapped();
  inactive_by_id_.erase(landmark.id);
  return landmark;
}

bool LandmarkMap::isGood(const Landmark& landmark) const {
  // Not the ids themselves: those of some front ends go up by more than one.
  const std::uint64_t mixed = (landmark.id * 0x9E3779B97F4A7C15) >> 32;
  return options_.keep == MapKeep::kAll || landmark.in_map ||
         (mixed % options_.one_in == 0 && landmark.observations >= kArchivedObservations &&
          secondsBetween(landmark.first_seen, landmark.last_seen) >= options_.min_track_s);
}

void LandmarkMap::leave(Filter& filter, std::size_t index) {
  const Landmark& landmark = active_[index];
  if (landmark.suspect || (keepsInactive() && isInactive(landmark.id))) {
    discard(filter, index); // not for the map, or there from before
  } else if (keepsInactive() && isGood(landmark)) {
    deactivate(filter, index);
  } else {
    if (landmark.observations >= kArchivedObservations) archive_.put(estimateOf(filter, landmark));
    discard(filter, index);
  }
}

void LandmarkMap::discard(Filter& filter, std::size_t index) {
  filter.remove(active_[index].variable);
  drop(index);
}

void LandmarkMap::deactivate(Filter& filter, std::size_t index) {
  filter.deactivate(active_[index].variable);
  putInactive(active_[index]);
  drop(index);
}

void LandmarkMap::reactivate(Filter& filter, const std::vector<FeatureId>& ids) {
  std::vector<Handle> handles;
  for (const FeatureId id : ids) handles.push_back(inactive_by_id_.at(id));
  filter.activate(handles);
  for (const Handle handle : handles) {
    active_.push_back(takeInactive(handle));
    active_.back().reactivated = true;
  }
}

void LandmarkMap::expect(std::vector<FeatureId> ids, Stamp now) {
  expected_ = std::move(ids);
  expected_since_ = now;
}

std::vector<FeatureId> LandmarkMap::expected(Stamp now) const {
  std::vector<FeatureId> ids;
  if (expected_.empty() || secondsBetween(expected_since_, now) > kExpectedTime) return ids;
  const auto active = indexById();
  for (const FeatureId id : expected_) {
    if (isInactive(id) && !active.count(id)) ids.push_back(id);
  }
  return ids;
}

/// A batch at a time, since means must be brought up to date; later, where a frame would wait for the thread
/// that settles.
std::vector<InactiveStore::Estimate> LandmarkMap::bound(Filter& filter, bool all) {
  if (!all && filter.inactive().isSettling()) return {};
  const std::size_t held = filter.inactive().size(), landmarks = inactive_.size();
  const std::size_t most = options_.max_landmarks;
  std::size_t count = all ? held : 0;
  if (!all && landmarks > most) count = landmarks - most + most / 4;
  if (!all && held - landmarks > std::max(kMostOthers, most / 2)) count = std::max(count, held / 4);
  if (count == 0) return {};
  std::vector<InactiveStore::Estimate> before = filter.inactive().estimates(false), others;
  // The first ones are the oldest.
  const std::size_t gone = filter.marginaliseOldest(count).size();
  for (std::size_t i = 0; i < gone; ++i) {
    InactiveStore::Estimate& estimate = before[i];
    if (!isLandmark(estimate.variable.handle)) {
      others.push_back(std::move(estimate));
      continue;
    }
    const Landmark landmark = takeInactive(estimate.variable.handle);
    if (landmark.observations >= kArchivedObservations)
      archive_.put({landmark.id, estimate.variable.mean, estimate.covariance});
  }
  return others;
}

void LandmarkMap::adopt(Filter& filter, const SavedMap& map, Eigen::MatrixXd covariance,
                        Eigen::MatrixXd cross, bool renumbered) {
  inactive_.clear();
  inactive_by_id_.clear();
  expected_.clear();
  std::vector<Eigen::Vector3d> positions;
  for (const SavedLandmark& landmark : map.landmarks) positions.push_back(landmark.position);
  const std::vector<Handle> handles = filter.adopt(positions, std::move(covariance), std::move(cross));
  for (std::size_t i = 0; i < handles.size(); ++i) {
    const SavedLandmark& from = map.landmarks[i];
    Landmark landmark{renumbered ? kRenumbered + i : from.id, handles[i], from.observations, map.stamp,
                      map.stamp};
    landmark.descriptors = from.descriptors;
    putInactive(std::move(landmark));
  }
}

void LandmarkMap::clear() {
  active_.clear();
  inactive_.clear();
  inactive_by_id_.clear();
  expected_.clear();
}

void LandmarkMap::archiveAll(const Filter& filter) {
  for (const LandmarkEstimate& l : estimates(filter, false)) {
    if (l.position.allFinite() && l.covariance.allFinite() && (l.covariance.diagonal().array() >= 0.0).all())
      archive_.put(l);
  }
  clear();
}

LandmarkEstimate LandmarkMap::estimateOf(const Filter& filter, const Landmark& landmark) const {
  return {landmark.id, filter.variables().point(landmark.variable),
          filter.worldCovariance(landmark.variable)};
}

std::vector<LandmarkEstimate> LandmarkMap::estimates(
    const Filter& filter, const std::vector<InactiveStore::Estimate>& inactive) const {
  // Of several estimates of one landmark the first stays: of one seen again but not yet fused the map's.
  std::vector<LandmarkEstimate> all;
  all.reserve(archive_.landmarks().size() + active_.size() + inactive_.size());
  for (const InactiveStore::Estimate& e : inactive) {
    const auto found = inactive_.find(e.variable.handle);
    if (found != inactive_.end()) all.push_back({found->second.id, e.variable.mean, e.covariance});
  }
  for (const Landmark& landmark : active_) all.push_back(estimateOf(filter, landmark));
  for (const auto& [id, landmark] : archive_.landmarks()) all.push_back(landmark);
  const auto less = [](const LandmarkEstimate& a, const LandmarkEstimate& b) { return a.id < b.id; };
  const auto same = [](const LandmarkEstimate& a, const LandmarkEstimate& b) { return a.id == b.id; };
  std::stable_sort(all.begin(), all.end(), less);
  all.erase(std::unique(all.begin(), all.end(), same), all.end());
  return all;
}

} // namespace vi_ekf_slam

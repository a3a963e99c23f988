#include "vi_ekf_slam/core/slam/joint_map.hpp"

#include <utility>

namespace vi_ekf_slam {

void JointMap::expect(Filter& filter, const StereoModel& model, const StereoFrame& frame,
                      const std::vector<std::size_t>& usable) {
  ReturningLandmarks::recognise(filter, landmarks_, frame, usable);
  if (recognition_ != PlaceRecognition::kNone) claimExpected(filter, landmarks_, model, frame, usable);
}

void JointMap::addPose(Filter& filter, Stamp now) {
  if (isKept()) clones_.add(filter, now);
}

void JointMap::closeLoops(Filter& filter, const StereoModel& model, FrameReport& report) {
  if (!isKept()) return;
  clones_.archive(landmarks_.bound(filter));
  const SE3 before = filter.pose();
  const Matrix6d covariance = filter.covariance().topLeftCorner<6, 6>();
  const Revisit revisit = tieToPlaces(filter, model, report);
  loop_.reset();
  if (revisit.landmarks > 0)
    loop_ = clones_.close(filter, report.stamp, before, covariance, revisit.last_seen, revisit.landmarks);
}

/// What the loop says that it has closed, if any: of several the one of the most landmarks.
Revisit JointMap::tieToPlaces(Filter& filter, const StereoModel& model, FrameReport& report) {
  settling_.advance(filter, report.stamp);
  Revisit revisit = returning_.update(filter, landmarks_, report.stamp, settling_);
  report.revisited += revisit.landmarks;
  const auto recognised = [&](const Revisit& place) {
    report.place_recognised |= place.landmarks > 0;
    if (place.landmarks > revisit.landmarks) revisit = place;
    return place.landmarks;
  };
  if (recognition_ != PlaceRecognition::kNone)
    report.revisited += recognised(by_appearance_.update(filter, landmarks_, report.stamp, settling_));
  if (recognition_ == PlaceRecognition::kConstellation)
    recognised(by_constellation_.update(filter, landmarks_, report.stamp, settling_));
  lookAhead(filter, landmarks_, model, report.stamp, settling_);
  report.relocalised = relocaliser_ && relocaliser_->update(filter, landmarks_, returning_, report.stamp);
  if (!report.relocalised) return revisit;
  by_appearance_.restart();
  by_constellation_.restart();
  noteRelocalised();
  return {};
}

/// The poses so far are in another world.
void JointMap::noteRelocalised() {
  relocaliser_.reset();
  use_ = MapUse::kRelocalised;
  clones_.clear();
}

void JointMap::loseAll(Filter& filter) {
  while (!landmarks_.active().empty()) landmarks_.leave(filter, landmarks_.active().size() - 1);
}

void JointMap::forgetLoops() {
  returning_.restart();
  by_appearance_.restart();
  by_constellation_.restart();
}

void JointMap::archive(const Filter& filter) {
  landmarks_.archiveAll(filter);
  clones_.archive(filter.inactive().estimates(false));
  clones_.breakOff();
  forgetLoops();
}

void JointMap::relocaliseIn(std::shared_ptr<const SavedMap> map) {
  relocaliser_.emplace(std::move(map));
  use_ = MapUse::kWaiting;
}

bool JointMap::placeIn(Filter& filter, const SE3& pose, const Matrix6d& covariance) {
  if (!relocaliser_ || !relocaliser_->placeAt(pose, covariance, filter, landmarks_)) return false;
  forgetLoops();
  noteRelocalised();
  return true;
}

/// Of a copy: what is large in it is shared.
std::function<MapEstimate()> JointMap::exact(const Filter& filter, Stamp now) const {
  return [filter = filter, landmarks = landmarks_, clones = clones_, now]() mutable {
    filter.settle();
    const auto inactive = filter.inactive().estimates(true);
    return MapEstimate{landmarks.estimates(filter, inactive), clones.estimate(filter, inactive, now)};
  };
}

PathEstimate JointMap::path(const Filter& filter, Stamp now) const {
  if (!isKept()) return {};
  Filter settled = filter;
  settled.settle();
  return clones_.estimate(settled, settled.inactive().estimates(false), now);
}

} // namespace vi_ekf_slam

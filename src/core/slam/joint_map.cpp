#include "vi_ekf_slam/core/slam/joint_map.hpp"

namespace vi_ekf_slam {

void JointMap::addPose(Filter& filter, Stamp now) {
  if (isKept()) clones_.add(filter, now);
}

void JointMap::closeLoops(Filter& filter, const StereoModel& model, FrameReport& report) {
  if (!isKept()) return;
  clones_.archive(landmarks_.bound(filter));
  const SE3 before = filter.pose();
  const Matrix6d covariance = filter.covariance().topLeftCorner<6, 6>();
  const Revisit revisit = closures_.update(filter, landmarks_, model, report);
  if (report.relocalised) forgetPath();
  loop_.reset();
  if (revisit.landmarks > 0)
    loop_ = clones_.close(filter, report.stamp, before, covariance, revisit.last_seen, revisit.landmarks);
}

void JointMap::loseAll(Filter& filter) {
  while (!landmarks_.active().empty()) landmarks_.leave(filter, landmarks_.active().size() - 1);
}

void JointMap::archive(const Filter& filter) {
  landmarks_.archiveAll(filter);
  clones_.archive(filter.inactive().estimates(false));
  clones_.breakOff();
  closures_.restart();
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

#pragma once

#include <functional>
#include <optional>

#include "vi_ekf_slam/core/loops/closures.hpp"
#include "vi_ekf_slam/core/map/pose_clones.hpp"

namespace vi_ekf_slam {

/// The map that a drive makes and the path through it: landmarks, clones of the pose, and what ties both to
/// what was seen before. What is out of view are inactive variables of one filter, which each call is given.
class JointMap {
 public:
  JointMap(const LandmarkMap::Options& options, PlaceRecognition recognition)
      : landmarks_(options), closures_(recognition) {}

  /// Whether what is out of view stays in the joint covariance; without it no path is kept either.
  bool isKept() const { return landmarks_.keepsInactive(); }
  LandmarkMap& landmarks() { return landmarks_; }
  const LandmarkMap& landmarks() const { return landmarks_; }
  Closures& closures() { return closures_; }
  const Closures& closures() const { return closures_; }
  /// That the last frame has closed.
  const std::optional<ClosedLoop>& closedLoop() const { return loop_; }

  /// A frame has corrected the pose; before it begins landmarks.
  void addPose(Filter& filter, Stamp now);
  /// At the end of the report's frame.
  void closeLoops(Filter& filter, const StereoModel& model, FrameReport& report);
  /// Nothing that was in view is tracked on.
  void loseAll(Filter& filter);
  /// The path begins anew: the poses so far are in another world.
  void forgetPath() { clones_.clear(); }
  /// The pose of now is not where motion alone has led.
  void breakOffPath() { clones_.breakOff(); }
  /// Of a filter that is to be given up all last estimates stay.
  void archive(const Filter& filter);
  /// Marginalises all that is out of view.
  void marginalise(Filter& filter) { landmarks_.bound(filter, true); }

  /// Landmarks and path with the covariances of now, see Estimator::exactMap.
  std::function<MapEstimate()> exact(const Filter& filter, Stamp now) const;
  /// See Estimator::path.
  PathEstimate path(const Filter& filter, Stamp now) const;

 private:
  LandmarkMap landmarks_;
  Closures closures_;
  PoseClones clones_;
  std::optional<ClosedLoop> loop_;
};

} // namespace vi_ekf_slam

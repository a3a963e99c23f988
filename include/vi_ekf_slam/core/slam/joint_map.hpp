#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/health/frame_report.hpp"
#include "vi_ekf_slam/core/loops/appearance_loops.hpp"
#include "vi_ekf_slam/core/loops/place_loops.hpp"
#include "vi_ekf_slam/core/loops/relocaliser.hpp"
#include "vi_ekf_slam/core/loops/returning_landmarks.hpp"
#include "vi_ekf_slam/core/loops/settling.hpp"
#include "vi_ekf_slam/core/map/pose_clones.hpp"

namespace vi_ekf_slam {

/// The map that a drive makes and the path through it: landmarks, clones of the pose, and all by which both
/// are tied to what is known of places from before: ids that return, places that are recognised, and a saved
/// map. What is out of view are inactive variables of one filter, which each call is given.
class JointMap {
 public:
  JointMap(const LandmarkMap::Options& options, PlaceRecognition recognition)
      : landmarks_(options), recognition_(recognition) {}

  /// Whether what is out of view stays in the joint covariance; without it no path is kept either.
  bool isKept() const { return landmarks_.keepsInactive(); }
  LandmarkMap& landmarks() { return landmarks_; }
  const LandmarkMap& landmarks() const { return landmarks_; }
  /// That the last frame has closed.
  const std::optional<ClosedLoop>& closedLoop() const { return loop_; }

  /// Before the frame's features are associated: landmarks that are expected in view become active.
  void expect(Filter& filter, const StereoModel& model, const StereoFrame& frame,
              const std::vector<std::size_t>& usable);
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
  /// What was about to be tied to what is not, any more.
  void forgetLoops();
  /// Of a filter that is to be given up all last estimates stay.
  void archive(const Filter& filter);
  /// Marginalises all that is out of view.
  void marginalise(Filter& filter) { landmarks_.bound(filter, true); }

  void relocaliseIn(std::shared_ptr<const SavedMap> map);
  /// Somebody says where in that map the vehicle is, see Relocaliser::placeAt.
  bool placeIn(Filter& filter, const SE3& pose, const Matrix6d& covariance);
  /// Filter and landmarks are those of a saved map.
  void noteResumed() { use_ = MapUse::kResumed; }
  MapUse use() const { return use_; }

  /// Landmarks and path with the covariances of now, see Estimator::exactMap.
  std::function<MapEstimate()> exact(const Filter& filter, Stamp now) const;
  /// See Estimator::path.
  PathEstimate path(const Filter& filter, Stamp now) const;

 private:
  Revisit tieToPlaces(Filter& filter, const StereoModel& model, FrameReport& report);
  void noteRelocalised();

  LandmarkMap landmarks_;
  PlaceRecognition recognition_;
  Settling settling_;
  ReturningLandmarks returning_;
  AppearanceLoops by_appearance_;
  PlaceLoops by_constellation_;
  std::optional<Relocaliser> relocaliser_; ///< while the place in a saved map is looked for
  MapUse use_ = MapUse::kNone;
  PoseClones clones_;
  std::optional<ClosedLoop> loop_;
};

} // namespace vi_ekf_slam

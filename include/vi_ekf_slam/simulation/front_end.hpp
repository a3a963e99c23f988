#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/simulation/appearance.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/random.hpp"
#include "vi_ekf_slam/simulation/scene.hpp"
#include "vi_ekf_slam/simulation/track_drift.hpp"
#include "vi_ekf_slam/simulation/traffic.hpp"

namespace vi_ekf_slam::simulation {

enum class ObservationKind : std::uint8_t {
  kStatic = 0,  ///< the projection of a static point plus noise
  kStale = 1,   ///< repeats the pixels of the frame before; from here on the id follows another static point
  kMoving = 2,  ///< the projection of a point on a moving object plus noise
  kOutlier = 3, ///< a wrong stereo match, or a track that drifts off its point
};

/// The truth behind one observation.
struct ObservationTruth {
  std::uint64_t point = 0; ///< identifies the 3-D point; an id that goes astray changes its point
  ObservationKind kind = ObservationKind::kStatic;
  Eigen::Vector3d world = Eigen::Vector3d::Zero(); ///< the point now, m
};

/// Detects, tracks and loses points as the front end of the real drives does. Between re-detections tracks
/// only end. A re-detection happens where tracks have become few, and at every STALE frame. There the
/// surviving tracks repeat their pixels bit for bit, and afterwards follow the static points that project
/// there from the stale frame's pose: z = h(m) + n holds for the new point m at the stale frame with n fresh
/// noise.
class FrontEnd {
 public:
  FrontEnd(const DriveOptions& options, const View& view, Scene& scene);

  struct Result {
    StereoFrame frame;                   ///< features ordered by id
    std::vector<ObservationTruth> truth; ///< of frame.features, in their order
    bool stale = false;
  };

  Result process(Stamp stamp, const SE3& world_T_imu, const std::vector<MovingObject>& objects);

 private:
  struct Track {
    FeatureId id = 0;
    ObservationTruth truth;
    StereoPixels pixels = StereoPixels::Zero();               ///< as last observed
    Stamp end = 0;                                            ///< from which on it is not observed any more
    std::optional<std::uint64_t> scene_index;                 ///< of a point of the scene
    std::optional<std::pair<std::uint64_t, std::size_t>> car; ///< moving object and the point on it
    std::uint64_t look = 0;                                   ///< what it looks like, see Appearance
    StereoPixels offset = StereoPixels::Zero();               ///< px off the projection (outliers, walks)
    StereoPixels velocity = StereoPixels::Zero();             ///< px/s, of `offset`
    SE3 first_drift_inverse;                                  ///< of TrackDrift::slide() when it was new
  };

  bool drawStale();
  StereoPixels noise();
  StereoPixels walk(double dt);
  bool follow(Track& track, double dt, const SE3& cam_T_world, const std::vector<MovingObject>& objects);
  bool goAstray(Track& track, const SE3& world_T_cam);
  void detect(const SE3& world_T_cam, const std::vector<MovingObject>& objects);
  void start(Track track, const SE3& cam_T_world);
  void makeOutlier(Track& track);

  DriveOptions options_;
  View view_;
  Scene& scene_;
  TrackDrift drift_;
  Appearance appearance_;
  Random noise_random_, track_random_, stale_random_, walk_random_, corner_random_;
  std::vector<Track> tracks_;
  std::map<std::uint64_t, std::pair<FeatureId, std::uint64_t>>
      known_; ///< scene index -> (id, point), ids_return
  FeatureId next_id_ = 0;
  std::uint64_t next_point_ = 0;
  Stamp stamp_ = 0;             ///< of the frame
  int frames_since_stale_ = -1; ///< -1 before the first frame
};

} // namespace vi_ekf_slam::simulation

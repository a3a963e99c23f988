#include "vi_ekf_slam/simulation/front_end.hpp"

#include <algorithm>
#include <cmath>

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kStaleGap = 0.3;   // s, the least from one stale frame to the next
constexpr double kFirstDrift = 0.1; // s for which a drifting track has drifted when it is new
constexpr double kLn2 = 0.6931471805599453;
constexpr double kLeastRefill = 0.7; // of features_max
// Above the numbers of any scene's points.
constexpr std::uint64_t kStaleLooks = std::uint64_t{1} << 40, kCarLooks = std::uint64_t{1} << 41;

} // namespace

FrontEnd::FrontEnd(const DriveOptions& options, const View& view, Scene& scene)
    : options_(options),
      view_(view),
      scene_(scene),
      drift_(options),
      appearance_(options),
      noise_random_(options.seed, RandomStream::kPixelNoise),
      track_random_(options.seed, RandomStream::kTracks),
      stale_random_(options.seed, RandomStream::kStaleFrames),
      walk_random_(options.seed, RandomStream::kTrackWalks),
      corner_random_(options.seed, RandomStream::kCorners) {}

FrontEnd::Result FrontEnd::process(Stamp stamp, const SE3& world_T_imu,
                                   const std::vector<MovingObject>& objects) {
  const SE3 cam_T_world = view_.rig.cam_T_imu * world_T_imu.inverse();
  const SE3 world_T_cam = cam_T_world.inverse();
  const bool first = frames_since_stale_ < 0;
  const bool stale = drawStale();
  const double dt = first ? 0.0 : secondsBetween(stamp_, stamp);
  stamp_ = stamp;
  drift_.advance(stamp, world_T_imu);
  std::vector<Track> survivors;
  for (Track& track : tracks_) {
    if (stamp >= track.end) continue;
    if (stale ? goAstray(track, world_T_cam) : follow(track, dt, cam_T_world, objects))
      survivors.push_back(track);
  }
  tracks_ = std::move(survivors);
  if (first || stale || tracks_.size() < static_cast<std::size_t>(options_.features_min)) {
    detect(world_T_cam, objects);
  }

  std::sort(tracks_.begin(), tracks_.end(), [](const Track& a, const Track& b) { return a.id < b.id; });
  Result result;
  result.frame.stamp = stamp;
  result.stale = stale;
  for (const Track& track : tracks_) {
    result.frame.features.push_back({track.id, track.pixels, 0.0, options_.track_walk});
    if (options_.descriptors) {
      result.frame.features.back().descriptor =
          appearance_.describe(track.look, track.truth.world - world_T_cam.translation());
    }
    result.truth.push_back(track.truth);
  }
  return result;
}

/// A geometric gap on top of the least one, of mean kStaleSlot / stale_fraction in all.
bool FrontEnd::drawStale() {
  if (frames_since_stale_ < 0 || options_.stale_fraction <= 0.0) {
    frames_since_stale_ = 0;
    return false;
  }
  const double mean = DriveOptions::kStaleSlot * options_.frame_rate / options_.stale_fraction; // frames
  const double least = std::max(1.0, std::ceil(kStaleGap * options_.frame_rate - 1e-9));
  if (++frames_since_stale_ < least) return false;
  const double hazard = 1.0 / (mean - (least - 1.0));
  if (stale_random_.uniform() >= hazard) return false;
  frames_since_stale_ = 0;
  return true;
}

/// Each coordinate N(0, pixel_sigma^2); left and right share `pixel_correlation` of the variance.
StereoPixels FrontEnd::noise() {
  const double shared = std::sqrt(options_.pixel_correlation),
               own = std::sqrt(1.0 - options_.pixel_correlation);
  const double u = shared * noise_random_.normal(), v = shared * noise_random_.normal();
  StereoPixels n(u, v, u, v);
  for (int i = 0; i < 4; ++i) n[i] += own * noise_random_.normal();
  return options_.pixel_sigma * n;
}

/// What a track strays in `dt` s, px: the patch that is searched for in the left image is the one that was
/// found there last, and the right image is matched to the left one.
StereoPixels FrontEnd::walk(double dt) {
  const double sigma = options_.track_walk * std::sqrt(dt);
  const double u = sigma * walk_random_.normal(), v = sigma * walk_random_.normal();
  return {u, v, u, v};
}

/// Observes the track's point again. False where it is lost.
bool FrontEnd::follow(Track& track, double dt, const SE3& cam_T_world,
                      const std::vector<MovingObject>& objects) {
  if (track.car) {
    const auto object = std::find_if(objects.begin(), objects.end(), [&track](const MovingObject& o) {
      return o.present() && o.id == track.car->first;
    });
    if (object == objects.end()) return false;
    track.truth.world = object->position + object->points[track.car->second];
  }
  const Eigen::Vector3d p = cam_T_world * (drift_.slide() * (track.first_drift_inverse * track.truth.world));
  if (!view_.sees(p)) return false;
  if (!track.car && scene_.occluded(cam_T_world.inverse().translation(), track.truth.world)) return false;
  track.offset += dt * track.velocity + walk(dt);
  const StereoPixels where = view_.rig.camera.project(p) + track.offset;
  if (!view_.contains(where)) return false;
  track.pixels = where + noise();
  if (track.truth.kind == ObservationKind::kStale) track.truth.kind = ObservationKind::kStatic;
  return true;
}

/// Keeps the pixels and takes the static point under them, whatever was followed before. False where there is
/// none.
bool FrontEnd::goAstray(Track& track, const SE3& world_T_cam) {
  const auto p_cam = view_.rig.camera.triangulate(track.pixels - noise());
  if (!p_cam || !view_.sees(*p_cam)) return false;
  track.truth.point = next_point_++;
  track.truth.world = world_T_cam * *p_cam;
  track.first_drift_inverse = drift_.slide().inverse();
  track.look = kStaleLooks + track.truth.point;
  track.truth.kind = ObservationKind::kStale;
  track.scene_index.reset();
  track.car.reset();
  track.offset.setZero();
  track.velocity.setZero();
  return true;
}

void FrontEnd::detect(const SE3& world_T_cam, const std::vector<MovingObject>& objects) {
  const SE3 cam_T_world = world_T_cam.inverse();
  const double fill = track_random_.uniform(kLeastRefill, 1.0);
  const auto target = static_cast<std::size_t>(std::lround(std::max(fill * options_.features_max, 1.0)));
  for (const MovingObject& object : objects) {
    for (std::size_t i = 0; object.present() && i < object.points.size(); ++i) {
      const std::pair<std::uint64_t, std::size_t> car(object.id, i);
      const bool tracked =
          std::any_of(tracks_.begin(), tracks_.end(), [&car](const Track& t) { return t.car == car; });
      Track track;
      track.truth.kind = ObservationKind::kMoving;
      track.truth.world = object.position + object.points[i];
      track.car = car;
      track.look = kCarLooks + 256 * object.id + i;
      if (!tracked && tracks_.size() < target) start(track, cam_T_world);
    }
  }
  if (tracks_.size() >= target) return;
  std::vector<std::uint64_t> taken;
  for (const Track& track : tracks_) {
    if (track.scene_index) taken.push_back(*track.scene_index);
  }
  // With ids that return, an astray track still bears the id of the point that it has left.
  if (options_.ids_return) {
    for (const auto& [index, known] : known_) {
      const FeatureId id = known.first;
      if (std::any_of(tracks_.begin(), tracks_.end(), [id](const Track& t) { return t.id == id; })) {
        taken.push_back(index);
      }
    }
  }
  std::sort(taken.begin(), taken.end());
  for (const ScenePoint& point : scene_.detect(world_T_cam, target - tracks_.size(), taken)) {
    Track track;
    track.truth.world = point.world + options_.corner_sigma * corner_random_.normal3();
    track.scene_index = point.index;
    track.look = point.look;
    if (track_random_.uniform() < options_.outlier_fraction) makeOutlier(track);
    start(track, cam_T_world);
  }
}

/// Names and observes a new track, if it can be seen.
void FrontEnd::start(Track track, const SE3& cam_T_world) {
  const Eigen::Vector3d p = cam_T_world * track.truth.world;
  if (!view_.sees(p)) return;
  const StereoPixels where = view_.rig.camera.project(p) + track.offset;
  if (!view_.contains(where)) return;
  track.first_drift_inverse = drift_.slide().inverse();
  const bool returning = options_.ids_return && track.scene_index;
  const auto known = returning ? known_.find(*track.scene_index) : known_.end();
  if (known != known_.end()) {
    track.id = known->second.first;
    track.truth.point = known->second.second;
  } else {
    track.id = next_id_++;
    track.truth.point = next_point_++;
    if (returning) known_[*track.scene_index] = {track.id, track.truth.point};
  }
  track.pixels = where + noise();
  const double life = track_random_.exponential() * options_.track_median / kLn2;
  track.end = stamp_ + fromSeconds(std::min(options_.track_max, life));
  tracks_.push_back(track);
}

/// Half of the outliers are matched to a wrong column of the right image, half drift away in both images.
void FrontEnd::makeOutlier(Track& track) {
  track.truth.kind = ObservationKind::kOutlier;
  if (track_random_.uniform() < 0.5) {
    track.offset[2] = track_random_.sign() * track_random_.uniform(8.0, 60.0);
  } else {
    const double angle = track_random_.uniform(0.0, 6.283185307179586),
                 speed = track_random_.uniform(20.0, 50.0); // px/s
    const double u = speed * std::cos(angle), v = speed * std::sin(angle);
    track.velocity = {u, v, u, v};
    track.offset = kFirstDrift * track.velocity;
  }
}

} // namespace vi_ekf_slam::simulation

#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "vi_ekf_slam/core/filter/validity.hpp"
#include "vi_ekf_slam/core/map/snapshot.hpp"

namespace vi_ekf_slam {
namespace {

// The world frame IS the first IMU frame; not zero, so that the covariance stays positive definite.
constexpr double kPosePriorSigma = 1e-6; // m, rad
constexpr double kLongestStep = 0.1;     // s, over which the twist may be taken as constant
constexpr double kTrackedGap = 1.0;      // s; nothing that was in view is tracked through a longer gap
constexpr double kBadFrames = 0.15;      // s, for which frames that contradict the local map say nothing else
// s, for which a rejected track must be seen in one place: a car would have gone on by several metres.
constexpr double kProbation = 2.0;
constexpr double kSamePlace = 11.345; // chi-square, 3 degrees of freedom, 99 %: of one place
constexpr double kSameView = 3.665;   // 70 %: of most points of one view
constexpr double kMostOfView = 0.5;
constexpr double kKnownHeading = 1.0; // rad, standard deviation: corrections of more are none that are linear

Matrix6d startCovariance() { return Vector6d::Constant(kPosePriorSigma * kPosePriorSigma).asDiagonal(); }

bool headingIsKnown(const Filter& filter) {
  return filter.covariance().diagonal().segment<3>(3).maxCoeff() <= kKnownHeading * kKnownHeading;
}

} // namespace

InvariantEstimator::InvariantEstimator(const InvariantConfig& config)
    : config_(config),
      motion_(std::make_shared<ConstantTwist>(config.motion)),
      slip_(config.slip),
      filter_(SE3(), startCovariance()),
      map_(config.map),
      standstill_(config.standstill_px),
      recovery_(config.recovery, *motion_) {
  begin(SE3(), startCovariance());
}

/// A filter that knows nothing but its pose.
void InvariantEstimator::begin(const SE3& pose, const Matrix6d& covariance) {
  filter_ = Filter(pose, covariance);
  motion_->addTo(filter_);
  if (config_.scale_sigma > 0.0)
    scale_ = filter_.augment(Chart::kVector, Eigen::VectorXd::Zero(1),
                             Eigen::MatrixXd::Constant(1, 1, config_.scale_sigma * config_.scale_sigma), {},
                             StereoModel::kScaleName);
  slip_.addTo(filter_);
  filter_.closeCore();
  last_position_ = pose.translation();
}

void InvariantEstimator::setRig(const StereoRig& rig) { model_.emplace(rig, config_.stereo, scale_); }

void InvariantEstimator::setGates(const Gates& gates) { vi_ekf_slam::setGates(config_, gates); }

// Gyro and velocity: motion -> health.

void InvariantEstimator::process(const GyroSample& sample) {
  advanceTo(sample.stamp);
  standstill_.addGyro(sample.stamp, sample.angular_velocity - motion_->gyroBias(filter_),
                      motion_->noiseOf(sample), motion_->gyroBiasCovariance(filter_));
  motion_->process(filter_, sample);
  recovery_.note(sample);
  checkpoint(false);
}

void InvariantEstimator::process(const VelocitySample& sample) {
  advanceTo(sample.stamp);
  standstill_.addVelocity(sample.stamp, sample.linear_velocity - motion_->bias(filter_).head<3>(),
                          motion_->noiseOf(sample));
  motion_->process(filter_, sample);
  recovery_.note(sample);
  checkpoint(false);
}

void InvariantEstimator::advanceTo(Stamp stamp) {
  if (resume_) resume(stamp);
  if (stamp_ && stamp > *stamp_) {
    const double dt = secondsBetween(*stamp_, stamp);
    if (dt > kTrackedGap) loseAll();
    const Vector6d twist = motion_->twist(filter_);
    recovery_.travel(dt * twist.head<3>().norm(), dt * twist.tail<3>().norm());
    propagate(filter_, dt);
  }
  stamp_ = stamp;
}

void InvariantEstimator::propagate(Filter& filter, double dt) const {
  const double steps = std::max(1.0, std::ceil(dt / kLongestStep - 0.1));
  for (int i = 0; i < static_cast<int>(steps); ++i) motion_->propagate(filter, dt / steps);
}

bool InvariantEstimator::canBridge(double gap_s) const {
  Filter ahead = filter_;
  propagate(ahead, gap_s);
  return headingIsKnown(ahead);
}

/// Remembers a valid estimate, and goes back to it from one that is not.
void InvariantEstimator::checkpoint(bool thoroughly) {
  if (recovery_.check(filter_, *stamp_, thoroughly)) return;
  divergence_ = Divergence::kCovariance;
  map_.archiveAll(filter_);
  map_.clear();
  returning_.restart();
  rejected_.clear();
  suspects_.clear();
  skipped_.clear();
  begin(recovery_.checkpointPose(),
        recovery_.checkpointCovariance(*stamp_, config_.motion.prior_twist_sigma[0]));
  standstill_ = StandstillDetector(config_.standstill_px);
}

// A frame: motion -> tracking -> observation -> filter -> health -> map.

FrameReport InvariantEstimator::process(const StereoFrame& frame) {
  advanceTo(frame.stamp);
  FrameReport report;
  report.stamp = frame.stamp;
  report.features = frame.features.size();
  handleStandstill(frame);
  const Eigen::Vector3d displacement = filter_.pose().translation() - last_position_;
  slip_.propagate(filter_, displacement.norm());
  slip_.apply(filter_, map_, displacement);
  filter_.settle();
  if (model_) {
    useFeatures(frame, report);
    if (map_.keepsInactive()) closeLoops(report);
  } else {
    report.invalid = report.features;
  }
  checkpoint(true);
  recovery_.endFrame();
  last_frame_ = frame.stamp;
  last_position_ = filter_.pose().translation();
  report.divergence = std::exchange(divergence_, Divergence::kNone);
  report.landmarks = map_.active().size();
  report.inactive = filter_.inactive().size();
  return report;
}

void InvariantEstimator::handleStandstill(const StereoFrame& frame) {
  if (!(config_.standstill_px > 0.0)) return;
  standstill_.addFrame(frame);
  if (last_frame_ && standstill_.stands(frame.stamp))
    motion_->processStandstill(filter_, secondsBetween(*last_frame_, frame.stamp));
}

/// Those of rejected tracks are not, until they have stood still for long enough; an id that left may come
/// back as something else.
std::vector<std::size_t> InvariantEstimator::usableFeatures(const StereoFrame& frame, FrameReport& report) {
  std::vector<std::size_t> usable;
  decltype(rejected_) still_rejected;
  std::unordered_set<FeatureId> still_suspect;
  for (std::size_t i = 0; i < frame.features.size(); ++i) {
    const StereoFeatureObservation& feature = frame.features[i];
    if (suspects_.count(feature.id)) still_suspect.insert(feature.id);
    const bool rejected = rejected_.count(feature.id) != 0 && !hasStood(feature.id, feature.pixels);
    if (rejected) still_rejected.insert(*rejected_.find(feature.id));
    if (!model_->isUsable(feature.pixels)) {
      ++report.invalid;
    } else if (rejected) {
      ++report.rejected;
    } else {
      usable.push_back(i);
    }
  }
  rejected_.swap(still_rejected);
  suspects_.swap(still_suspect);
  return usable;
}

/// Whether a rejected track is one of the static world. Else it is watched from here on.
bool InvariantEstimator::hasStood(FeatureId id, const StereoPixels& pixels) {
  std::optional<StandingTrack>& track = rejected_[id];
  const auto seen = model_->isUsable(pixels) ? model_->triangulate(filter_, pixels) : std::nullopt;
  if (seen && track && track->distanceTo(filter_, *seen) < kSamePlace)
    return secondsBetween(track->since(), *stamp_) >= kProbation;
  track = seen ? std::make_optional<StandingTrack>(filter_, *seen, *stamp_) : std::nullopt;
  return false;
}

void InvariantEstimator::useFeatures(const StereoFrame& frame, FrameReport& report) {
  const std::vector<std::size_t> usable = usableFeatures(frame, report);
  Associations seen = associate(filter_, map_, *model_, frame, usable);
  const FrameOutcome outcome =
      FrameUpdate(config_.update, *model_, *motion_).apply(filter_, std::move(seen.measurements));
  report.used = static_cast<std::size_t>(std::count(outcome.used.begin(), outcome.used.end(), true));
  report.rejected += seen.known.size() - report.used;
  report.frame_rejected = outcome.skipped;
  report.nis = outcome.nis;
  report.nis_dof = outcome.nis_dof;
  const Divergence divergence = recovery_.judge(filter_, map_, *model_, frame, seen.known, outcome);
  if (divergence != Divergence::kNone) divergence_ = divergence;
  if (divergence != Divergence::kNone || (outcome.skipped && !isBelieved(frame, seen))) {
    beginMapAnew(frame, usable, report);
  } else if (!outcome.skipped) {
    last_used_ = frame.stamp;
    skipped_.clear();
    recovery_.useFrame();
    updateTracks(frame, seen, outcome, report);
    initialise(frame, seen.unknown, report);
  } // a skipped frame leaves the local map as it is
}

/// Whether the local map is, more than a frame that contradicts it. It is not what is in view where the front
/// end has begun other tracks than it has, where the frames agree among themselves on what else stands there,
/// or where they have contradicted it for too long.
bool InvariantEstimator::isBelieved(const StereoFrame& frame, const Associations& seen) {
  if (!last_used_ || !last_frame_) return false;
  const auto begun = std::count_if(seen.unknown.begin(), seen.unknown.end(), [&](std::size_t feature) {
    return skipped_.count(frame.features[feature].id) == 0;
  });
  if (static_cast<std::size_t>(begun) > seen.known.size()) return false;
  const bool is_other = isAnotherView(frame, seen);
  const double contradicted = secondsBetween(*last_used_, frame.stamp);
  return *last_used_ == *last_frame_ || contradicted < kBadFrames ||
         (contradicted < kTrackedGap && !is_other);
}

/// Whether most tracks are seen where earlier frames that were skipped saw them.
bool InvariantEstimator::isAnotherView(const StereoFrame& frame, const Associations& seen) {
  std::size_t same = 0, all = 0;
  const auto look = [&](std::size_t i) {
    const StereoFeatureObservation& feature = frame.features[i];
    const auto now = model_->triangulate(filter_, feature.pixels);
    if (!now) return;
    const auto before = skipped_.find(feature.id);
    if (before != skipped_.end()) ++all;
    if (before != skipped_.end() && before->second.distanceTo(filter_, *now) < kSameView)
      ++same;
    else
      skipped_.insert_or_assign(feature.id, StandingTrack(filter_, *now, frame.stamp));
  };
  for (const Association& known : seen.known) look(known.feature);
  for (const std::size_t feature : seen.unknown) look(feature);
  return same > 0 && static_cast<double>(same) > kMostOfView * static_cast<double>(all);
}

/// Nothing speaks against these features but a local map that is not believed.
void InvariantEstimator::beginMapAnew(const StereoFrame& frame, const std::vector<std::size_t>& usable,
                                      FrameReport& report) {
  report.removed += map_.active().size();
  loseAll();
  rejected_.clear();
  suspects_.clear();
  skipped_.clear();
  last_used_ = frame.stamp;
  recovery_.useFrame();
  initialise(frame, usable, report);
}

void InvariantEstimator::loseAll() {
  while (!map_.active().empty()) map_.leave(filter_, map_.active().size() - 1);
}

/// Rejected tracks contradict the static world (a car, a track that slides): they leave the map for good,
/// even if they are used again. Lost ones go where the map keeps what is out of view.
void InvariantEstimator::updateTracks(const StereoFrame& frame, const Associations& seen,
                                      const FrameOutcome& outcome, FrameReport& report) {
  enum class Track { kLost, kUsed, kRejected };
  std::vector<Track> tracks(map_.active().size(), Track::kLost);
  for (std::size_t i = 0; i < seen.known.size(); ++i) {
    const auto [landmark, feature] = seen.known[i];
    tracks[landmark] = outcome.used[i] ? Track::kUsed : Track::kRejected;
    if (outcome.used[i]) continue;
    hasStood(frame.features[feature].id, frame.features[feature].pixels); // from now on
    suspects_.insert(frame.features[feature].id);
  }
  std::unordered_set<FeatureId> begins_anew;
  for (const std::size_t feature : seen.unknown) begins_anew.insert(frame.features[feature].id);
  for (std::size_t i = tracks.size(); i-- > 0;) {
    Landmark& landmark = map_.active(i);
    if (tracks[i] == Track::kUsed) {
      if (landmark.reactivated) ++report.revisited;
      landmark.reactivated = false;
      landmark.last_seen = frame.stamp;
      ++landmark.observations;
      continue;
    }
    const bool expected = tracks[i] == Track::kLost && !begins_anew.count(landmark.id) &&
                          !rejected_.count(landmark.id) &&
                          ReturningLandmarks::isExpected(landmark, filter_, *model_, frame.stamp);
    if (expected) continue;
    ++report.removed;
    if (tracks[i] == Track::kRejected)
      map_.discard(filter_, i);
    else
      map_.leave(filter_, i);
  }
}

void InvariantEstimator::initialise(const StereoFrame& frame, const std::vector<std::size_t>& features,
                                    FrameReport& report) {
  for (const std::size_t feature : features) {
    const StereoFeatureObservation& f = frame.features[feature];
    const auto seen = model_->triangulate(filter_, f.pixels);
    if (!seen) continue;
    const Handle variable = filter_.augment(Chart::kPoint, seen->position, seen->noise, seen->by);
    map_.add({f.id, variable, 1, frame.stamp, frame.stamp, false, false, suspects_.count(f.id) != 0});
    ++report.initialised;
  }
}

void InvariantEstimator::closeLoops(FrameReport& report) {
  const double seconds = last_frame_ ? secondsBetween(*last_frame_, *stamp_) : 0.0;
  map_.bound(filter_);
  report.revisited += returning_.update(filter_, map_, *model_, *stamp_, seconds);
  if (config_.recognise_places) report.place_recognised = places_.update(filter_, map_, *stamp_, seconds);
  if (relocaliser_ && relocaliser_->update(filter_, map_, returning_, *model_, *stamp_)) {
    report.relocalised = true;
    relocaliser_.reset();
    map_use_ = MapUse::kRelocalised;
  }
}

// What goes out, and comes back.

StateEstimate InvariantEstimator::state() const {
  StateEstimate estimate;
  estimate.stamp = stamp_.value_or(0);
  estimate.world_T_imu = filter_.pose();
  estimate.pose_covariance = filter_.covariance().topLeftCorner<6, 6>();
  estimate.twist = motion_->twist(filter_);
  estimate.twist_covariance = motion_->twistCovariance(filter_);
  return estimate;
}

std::vector<LandmarkEstimate> InvariantEstimator::landmarks() const {
  Filter settled = filter_;
  settled.settle();
  return map_.estimates(settled, false);
}

/// Of a copy: what is large in it is shared.
std::function<std::vector<LandmarkEstimate>()> InvariantEstimator::exactMap() const {
  return [filter = filter_, map = map_]() mutable {
    filter.settle();
    return map.estimates(filter, true);
  };
}

std::function<SavedMap()> InvariantEstimator::savedMap() const {
  if (!keepsJointMap() || !stamp_) return {};
  return [filter = filter_, map = map_, stamp = *stamp_] { return snapshotOf(filter, map, stamp); };
}

void InvariantEstimator::relocaliseIn(std::shared_ptr<const SavedMap> map) {
  relocaliser_.emplace(std::move(map));
  map_use_ = MapUse::kWaiting;
}

void InvariantEstimator::resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source,
                                    double max_gap_s) {
  requireMotion(*map, filter_, *motion_, source);
  resume_ = Resume{std::move(map), max_gap_s};
  map_use_ = MapUse::kWaiting;
}

void InvariantEstimator::resume(Stamp stamp) {
  const Resume from = *std::exchange(resume_, std::nullopt);
  const double gap = secondsBetween(from.map->stamp, stamp);
  if (gap >= 0.0 && gap <= from.max_gap_s) {
    restore(*from.map, filter_, map_);
    if (isValid(filter_, true) && canBridge(gap)) {
      stamp_ = from.map->stamp;
      last_position_ = filter_.pose().translation();
      map_use_ = MapUse::kResumed;
      return;
    }
    map_.clear();
    begin(SE3(), startCovariance());
  }
  relocaliseIn(from.map);
}

} // namespace vi_ekf_slam

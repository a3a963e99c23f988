#include "vi_ekf_slam/core/slam/invariant_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "vi_ekf_slam/core/filter/validity.hpp"
#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/map/snapshot.hpp"
#include "vi_ekf_slam/core/observation/body_twist.hpp"
#include "vi_ekf_slam/core/tracking/new_landmarks.hpp"
#include "vi_ekf_slam/core/tracking/track_walk.hpp"
#include "vi_ekf_slam/core/tracking/twist_guess.hpp"

namespace vi_ekf_slam {
namespace {

// The world begins at the IMU; not zero, so that the covariance stays positive definite.
constexpr double kPosePriorSigma = 1e-6; // m, rad
constexpr double kLongestStep = 0.1;     // s, over which the twist may be taken as constant
constexpr double kTrackedGap = 1.0;      // s; nothing that was in view is tracked through a longer gap
// Times max_tracked, while a vehicle looks for its place in a map: of few landmarks in view too few are the
// map's. By looks alone one simulated lap of eight takes 490 of 600 frames with 1, and none more than 220 so.
constexpr double kWhileLost = 1.5;
constexpr double kSameAxes = 0.5; // rad: nearer than any other way to mount it

Matrix6d startCovariance() { return independentPose(kPosePriorSigma, kPosePriorSigma); }

std::shared_ptr<MotionModel> makeMotion(const InvariantConfig& config) {
  if (config.choice == MotionChoice::kInertial) return std::make_shared<Inertial>(config.inertial);
  return std::make_shared<ConstantTwist>(config.motion);
}

} // namespace

InvariantEstimator::InvariantEstimator(const InvariantConfig& config)
    : config_(config),
      motion_(makeMotion(config)),
      imu_(config.inertial.noise, config.inertial.noise_given),
      slip_(config.slip),
      filter_(SE3(), startCovariance()),
      map_(config.map, config.recognise_places),
      standstill_(config.standstill_px, motion_->measuresVelocity()),
      recovery_(config.recovery, *motion_) {
  begin(motion_->startPose(), startCovariance());
  if (config.told_bias) InvariantEstimator::setBiasPrior(*config.told_bias);
  if (config.told_rig) InvariantEstimator::setRig(*config.told_rig);
}

/// A filter that knows nothing but its pose.
void InvariantEstimator::begin(const SE3& pose, const Matrix6d& covariance) {
  if (model_) model_->forgetScene(filter_);
  filter_ = Filter(pose, covariance);
  motion_->addTo(filter_);
  RigVariables::addTo(filter_, config_.rig);
  // An IMU tells a body's scale and turns where slipping tracks would be believed.
  if (!filter_.isLevel()) slip_.addTo(filter_);
  filter_.closeCore();
  if (last_frame_) last_frame_->position = pose.translation();
}

bool InvariantEstimator::begin(const InitialState& state) {
  if (!motion_->begin(filter_, state)) return false;
  stamp_ = state.stamp;
  return true;
}

/// An error of where the world is and which way it faces is one of the pose's first six coordinates alone:
/// none is left of it where the world is said to be here.
void InvariantEstimator::moveOriginHere() {
  const SE3& pose = filter_.pose();
  const Eigen::Matrix3d level = so3::Exp({0.0, 0.0, -so3::heading(pose.rotation())});
  moveWorld(SE3(level, -(level * pose.translation())));
  for (const Eigen::Index row : {0, 1, 2, 5})
    filter_.makeIndependent(row, startCovariance().block<1, 1>(row, row));
}

/// An error of the place by dp, and of the heading by theta, moves the body of now by dp - [p - there]x
/// theta. The tilt is known here.
void InvariantEstimator::moveOrigin(const SE3& begun, const StateEstimate& there) {
  moveWorld(levelled(there.world_T_imu, begun) * begun.inverse());
  Matrix6d J = Matrix6d::Identity(), known = there.pose_covariance;
  J.topRows<3>() = se3::pointJacobian(filter_.pose().translation() - there.world_T_imu.translation());
  known.middleRows<2>(3).setZero();
  known.middleCols<2>(3).setZero();
  filter_.addNoise(0, J * known * J.transpose());
}

void InvariantEstimator::moveWorld(const SE3& to_T_world) {
  map_.marginalise(filter_);
  map_.forgetPath();
  filter_.moveWorld(to_T_world);
  if (last_frame_) last_frame_->position = filter_.pose().translation();
}

/// A camera alone is the body itself, and some IMUs have their camera's axes.
void InvariantEstimator::setRig(const StereoRig& rig) {
  if (!stamp_ && so3::Log(rig.cam_T_imu.rotation()).norm() < kSameAxes) {
    motion_->setOpticalBody();
    begin(motion_->startPose(), startCovariance());
  }
  model_.emplace(rig, config_.stereo, RigVariables(filter_.variables()));
}

// Gyro and velocity: motion -> health.

void InvariantEstimator::process(const ImuSample& sample) {
  imu_.expect(sample);
  advanceTo(sample.stamp);
  imu_.reach(sample);
  const Eigen::Matrix3d noise = motion_->noiseOf(sample, imu_);
  standstill_.addGyro(sample.stamp, sample.angular_velocity - motion_->gyroBias(filter_), noise,
                      motion_->gyroBiasCovariance(filter_));
  motion_->process(filter_, sample);
  recovery_.noteGyro(sample.stamp, noise);
  checkpoint(false);
}

void InvariantEstimator::process(const VelocitySample& sample) {
  advanceTo(sample.stamp);
  standstill_.addVelocity(sample.stamp, sample.linear_velocity - motion_->bias(filter_).head<3>(),
                          motion_->noiseOf(sample));
  if (!correctByVelocity(filter_, motion_->measure(filter_, sample))) ++contradicting_velocities_;
  recovery_.noteVelocity(sample.stamp, motion_->noiseOf(sample));
  checkpoint(false);
}

void InvariantEstimator::advanceTo(Stamp stamp) {
  resumeAt(stamp);
  if (stamp_ && stamp > *stamp_) {
    const double dt = secondsBetween(*stamp_, stamp);
    if (dt > kTrackedGap) map_.loseAll(filter_);
    const Vector6d twist = motion_->twist(filter_, imu_, *stamp_);
    recovery_.travel(dt * twist.head<3>().norm(), dt * twist.tail<3>().norm());
    propagate(filter_, imu_, *stamp_, stamp);
  }
  stamp_ = stamp;
}

void InvariantEstimator::propagate(Filter& filter, const ImuTrack& imu, Stamp from, Stamp to) const {
  const auto steps =
      static_cast<Stamp>(std::max(1.0, std::ceil(secondsBetween(from, to) / kLongestStep - 0.1)));
  for (Stamp i = 0; from < to && i < steps; ++i)
    motion_->propagate(filter, imu, from + (to - from) * i / steps, from + (to - from) * (i + 1) / steps);
}

/// Remembers a valid estimate, and goes back to it from one that is not.
void InvariantEstimator::checkpoint(bool thoroughly) {
  if (recovery_.check(filter_, *stamp_, thoroughly)) return;
  map_.archive(filter_);
  tracks_.clear();
  begin(recovery_.checkpointPose(),
        recovery_.checkpointCovariance(*stamp_, config_.motion.prior_twist_sigma[0]));
  standstill_ = StandstillDetector(config_.standstill_px, motion_->measuresVelocity());
}

// A frame: motion -> tracking -> observation -> filter -> health -> map.

void InvariantEstimator::guessTwistOf(const StereoFrame& frame) {
  const double dt = model_ && stamp_ ? secondsBetween(*stamp_, frame.stamp) : 0.0;
  if (dt <= 0.0 || dt > kTrackedGap) return;
  guessTwist(filter_, FrameUpdate(config_.update, *model_, *motion_), map_.landmarks(), frame, dt,
             [&](Filter& filter) { propagate(filter, imu_, *stamp_, frame.stamp); });
}

FrameReport InvariantEstimator::process(const StereoFrame& frame) {
  guessTwistOf(frame);
  advanceTo(frame.stamp);
  FrameReport report(frame);
  report.contradicting_velocities = std::exchange(contradicting_velocities_, 0);
  if (config_.standstill_px > 0.0) standstill_.addFrame(frame);
  if (config_.standstill_px > 0.0 && last_frame_ && standstill_.stands(frame.stamp) &&
      motion_->mayStand(filter_))
    motion_->processStandstill(filter_, imu_, frame.stamp, secondsSinceFrame(frame.stamp));
  Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
  if (last_frame_) displacement = filter_.pose().translation() - last_frame_->position;
  if (TrackSlip::isPossible(frame)) {
    slip_.propagate(filter_, displacement.norm());
    slip_.apply(filter_, map_.landmarks(), displacement);
  }
  filter_.settle();
  if (model_) {
    useFeatures(frame, report);
    map_.closeLoops(filter_, *model_, report);
  } else {
    report.invalid = report.features;
  }
  checkpoint(true);
  recovery_.endFrame();
  last_frame_ = LastFrame{frame.stamp, filter_.pose().translation()};
  report.divergence = recovery_.takeDivergence();
  report.landmarks = map_.landmarks().active().size();
  report.inactive = map_.landmarks().inactiveCount();
  return report;
}

void InvariantEstimator::useFeatures(const StereoFrame& frame, FrameReport& report) {
  model_->beginFrame(frame.time_offset, motion_->twist(filter_, imu_, frame.stamp));
  const TrackStatus::Usable usable = tracks_.usable(filter_, *model_, frame);
  report.invalid = usable.invalid;
  LandmarkMap& landmarks = map_.landmarks();
  map_.expect(filter_, *model_, frame, usable.features);
  Associations seen = associate(filter_, landmarks, *model_, frame, usable.features);
  letTracksWalk(filter_, landmarks, *model_, frame, seen.known, secondsSinceFrame(frame.stamp));
  const FrameOutcome outcome =
      FrameUpdate(config_.update, *model_, *motion_).apply(filter_, std::move(seen.measurements));
  report.used = countTrue(outcome.used);
  report.rejected_now = seen.known.size() - report.used;
  report.rejected = usable.rejected + report.rejected_now;
  report.frame_rejected = outcome.skipped;
  report.nis = outcome.nis;
  report.nis_dof = outcome.nis_dof;
  const Divergence divergence = recovery_.judge(filter_, landmarks, *model_, frame, seen.known, outcome);
  const auto last = last_frame_ ? std::make_optional(last_frame_->stamp) : std::nullopt;
  const bool begins = divergence != Divergence::kNone ||
                      (outcome.skipped && !tracks_.believesMap(filter_, *model_, frame, seen, last));
  if (!begins && outcome.skipped) return; // which leaves the local map as it is
  tracks_.noteUse(frame.stamp);
  recovery_.useFrame();
  if (begins) {
    report.removed += landmarks.active().size();
    map_.loseAll(filter_);
    tracks_.clear();
  } else {
    updateTracks(frame, seen, outcome, report);
  }
  map_.addPose(filter_, frame.stamp);
  // Nothing speaks against all of them but a local map that is not believed.
  initialise(frame, begins ? usable.features : seen.unknown, report);
}

/// Rejected tracks contradict the static world (a car, a track that slides): they leave the map for good,
/// even if they are used again. Lost ones go where the map keeps what is out of view.
void InvariantEstimator::updateTracks(const StereoFrame& frame, const Associations& seen,
                                      const FrameOutcome& outcome, FrameReport& report) {
  enum class Track { kLost, kUsed, kMissed, kRejected };
  LandmarkMap& landmarks = map_.landmarks();
  std::vector<Track> tracks(landmarks.active().size(), Track::kLost);
  for (std::size_t i = 0; i < seen.known.size(); ++i) {
    const auto [landmark, feature] = seen.known[i];
    Landmark& known = landmarks.active(landmark);
    const bool is_missed = outcome.missed[i] && !std::exchange(known.missed, true);
    tracks[landmark] = outcome.used[i] ? Track::kUsed : is_missed ? Track::kMissed : Track::kRejected;
    if (outcome.used[i]) {
      known.missed = false;
      if (frame.features[feature].descriptor) known.descriptors.add(*frame.features[feature].descriptor);
    }
    if (tracks[landmark] == Track::kRejected) tracks_.reject(filter_, *model_, frame, feature);
  }
  for (std::size_t i = tracks.size(); i-- > 0;) {
    Landmark& landmark = landmarks.active(i);
    if (tracks[i] == Track::kUsed) {
      if (landmark.reactivated) ++report.revisited;
      landmark.reactivated = false;
      landmark.last_seen = frame.stamp;
      ++landmark.observations;
      continue;
    }
    if (tracks[i] == Track::kMissed) continue;
    ++report.removed;
    if (tracks[i] == Track::kRejected)
      landmarks.discard(filter_, i);
    else
      landmarks.leave(filter_, i);
  }
}

void InvariantEstimator::initialise(const StereoFrame& frame, const std::vector<std::size_t>& features,
                                    FrameReport& report) {
  if (is_starting_) model_->lookAtScene(filter_, frame, features);
  LandmarkMap& landmarks = map_.landmarks();
  const double share = mapUse() == MapUse::kWaiting ? kWhileLost : 1.0;
  const auto most = static_cast<std::size_t>(share * static_cast<double>(config_.max_tracked));
  for (const std::size_t feature :
       chooseNewLandmarks(frame, model_->rig().camera, landmarks, features, most)) {
    const StereoFeatureObservation& f = frame.features[feature];
    const auto seen = model_->triangulate(filter_, f.pixels, f.sigma);
    if (!seen) continue;
    const Handle variable = filter_.augment(Chart::kPoint, seen->position, seen->noise, seen->by);
    Landmark landmark{f.id, variable, 1, frame.stamp, frame.stamp};
    landmark.suspect = tracks_.isSuspect(f.id);
    if (f.descriptor) landmark.descriptors.add(*f.descriptor);
    landmarks.add(landmark);
    ++report.initialised;
  }
}

// What goes out, and comes back.

StateEstimate InvariantEstimator::state() const {
  const Stamp stamp = stamp_.value_or(0);
  return {stamp, filter_.pose(), filter_.covariance().topLeftCorner<6, 6>(),
          motion_->twist(filter_, imu_, stamp), motion_->twistCovariance(filter_, imu_)};
}

std::optional<RigEstimate> InvariantEstimator::rig() const {
  if (!model_) return std::nullopt;
  return model_->variables().estimate(filter_, model_->rig(), config_.rig.time_offset);
}

double InvariantEstimator::timeOffset() const {
  const RigVariables variables(filter_.variables());
  return variables.hasTimeOffset() ? variables.timeOffset(filter_) : config_.rig.time_offset;
}

/// What is in view was seen from elsewhere, so that it is not tracked on; its ids may return.
bool InvariantEstimator::setPose(const SE3& world_T_imu, const Matrix6d& covariance) {
  if (resume_map_) relocaliseIn(std::exchange(resume_map_, nullptr));
  if (mapUse() == MapUse::kWaiting) {
    if (!map_.placeIn(filter_, world_T_imu, covariance)) return false;
  } else {
    const Filter before = filter_;
    const LandmarkMap landmarks_before = map_.landmarks();
    map_.loseAll(filter_);
    map_.forgetLoops();
    if (!recovery_.relocate(filter_, world_T_imu, covariance)) {
      filter_ = before;
      map_.landmarks() = landmarks_before;
      return false;
    }
  }
  map_.breakOffPath();
  tracks_.clear();
  if (last_frame_) last_frame_->position = filter_.pose().translation();
  return true;
}

std::vector<LandmarkEstimate> InvariantEstimator::landmarks() const {
  Filter settled = filter_;
  settled.settle();
  return map_.landmarks().estimates(settled, false);
}

std::function<MapEstimate()> InvariantEstimator::exactMap() const {
  return map_.exact(filter_, stamp_.value_or(0));
}

PathEstimate InvariantEstimator::path() const { return map_.path(filter_, stamp_.value_or(0)); }

std::function<SavedMap()> InvariantEstimator::savedMap() const {
  if (!keepsJointMap() || !stamp_) return {};
  return [filter = filter_, landmarks = map_.landmarks(), stamp = *stamp_, rig = givenRig()] {
    return snapshotOf(filter, landmarks, stamp, rig);
  };
}

void InvariantEstimator::resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source,
                                    double max_gap_s) {
  requireMotion(*map, filter_, *motion_, source);
  resume_map_ = std::move(map);
  max_gap_s_ = max_gap_s;
}

bool InvariantEstimator::resumeAt(Stamp now) {
  const auto map = std::exchange(resume_map_, nullptr);
  if (!map) return false;
  const double gap = secondsBetween(map->stamp, now);
  if (gap >= 0.0 && gap <= max_gap_s_) {
    restore(*map, filter_, map_.landmarks(), givenRig());
    if (isValid(filter_, true) && canBridge(gap)) {
      stamp_ = map->stamp;
      map_.noteResumed();
      return true;
    }
    map_.landmarks().clear();
    begin(motion_->startPose(), startCovariance());
  }
  relocaliseIn(map);
  return false;
}

} // namespace vi_ekf_slam

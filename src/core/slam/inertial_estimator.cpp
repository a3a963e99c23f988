#include "vi_ekf_slam/core/slam/inertial_estimator.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

// Of the landmarks in view: wrong axes and a fit that was none make it 0.4 to 1, most of them above 0.7, and
// three matches in ten that are wrong as much as this.
constexpr double kLargestRejection = 0.5;
constexpr std::size_t kNewestFrames = 2; // that see landmarks: what a start is wrong by has grown longest
// s. Over it a hand's 20 rad/s^2 turn a picture by 0.04 mrad more than what is linear in it, a small part of
// a pixel.
constexpr double kLinearClock = 0.002;
// s from a try that was refused, which costs what two seconds of frames cost, to the next.
constexpr double kPatience = 0.5;
constexpr double kLearnt = 1.0 / 3.0; // of a prior's sigma: what is left of one that hardly counts any more
// What a hand carries through a room sees the same view every few seconds.
constexpr std::size_t kKeptOneIn = 4;
// s since it has diverged, for which an estimate is verified.
constexpr double kVerification = 10.0;
// In that time: once the estimate diverges of much that has nothing to do with the IMU (a lorry, a covered
// camera).
constexpr int kDivergences = 2;
// rad. What is tilted by less finds back by itself, as from a start, which may be as wrong.
constexpr double kLargestTilt = 0.2;
// s after the first measurement, at which a state may be given. One of later is of another time.
constexpr double kSoon = 10.0;
// Times what is expected of the accelerometer's bias: this is none, but what explains something else.
constexpr double kImplausibleBias = 10.0;

} // namespace

InertialEstimator::InertialEstimator(const InvariantConfig& config)
    : config_(config), problem_("waits for frames") {
  config_.choice = MotionChoice::kInertial;
  config_.map.one_in = kKeptOneIn;
  alignment_ = std::make_unique<InertialAlignment>(config_);
}

template <class Tell>
void InertialEstimator::tellAll(const Tell& tell) {
  if (filter_) tell(*filter_);
  if (resuming_) tell(*resuming_);
  if (alignment_) tell(*alignment_);
}

void InertialEstimator::setRig(const StereoRig& rig) {
  config_.told_rig = rig;
  tellAll([&rig](auto& part) { part.setRig(rig); });
}

void InertialEstimator::setBiasPrior(const TwistBias& bias) {
  config_.told_bias = bias;
  tellAll([&bias](auto& part) { part.setBiasPrior(bias); });
}

void InertialEstimator::setGates(const Gates& gates) {
  config_.setGates(gates);
  tellAll([&gates](auto& part) { part.setGates(gates); });
}

bool InertialEstimator::begin(const InitialState& state) {
  if (filter_) return false;
  given_ = state;
  return true;
}

void InertialEstimator::expect(const ImuSample& next) {
  tellAll([&next](auto& part) { part.expect(next); });
}

/// From what was saved or given.
void InertialEstimator::tryToGoOn(Stamp now) {
  if (filter_) return;
  if (resuming_ && resuming_->resumeAt(now)) {
    filter_ = std::move(resuming_);
    alignment_.reset();
    return;
  }
  resuming_.reset();
  tryGiven(now);
}

/// With the first measurement that is not older than a given state the filter is there.
void InertialEstimator::tryGiven(Stamp now) {
  if (!given_) return;
  const double gap = secondsBetween(given_->stamp, now);
  if (gap < 0.0 && -gap <= kSoon) return;
  auto filter = std::make_unique<InvariantEstimator>(config_);
  const InitialState state = *std::exchange(given_, std::nullopt);
  if (gap < 0.0) {
    refusal_ = "the given state is " + rounded(-gap) + " s newer than the first measurement; ";
    return;
  }
  filter->begin(state);
  filter->preset(alignment_->imu());
  if (!filter->canBridge(gap)) {
    refusal_ = "the given state is " + rounded(gap) + " s older than the first measurement; ";
    return;
  }
  if (map_) filter->relocaliseIn(map_);
  filter_ = std::move(filter);
  alignment_.reset();
}

void InertialEstimator::process(const ImuSample& sample) {
  if (!filter_) expect(sample); // what goes on from before asks how far that is
  tryToGoOn(sample.stamp);
  tellAll([&sample](auto& part) { part.process(sample); });
}

void InertialEstimator::process(const VelocitySample& sample) {
  tryToGoOn(sample.stamp);
  tellAll([&sample](auto& part) { part.process(sample); });
}

FrameReport InertialEstimator::process(const StereoFrame& frame) {
  tryToGoOn(frame.stamp);
  if (filter_) {
    const FrameReport report = filter_->process(frame);
    verify(frame, report.divergence);
    return report;
  }
  if (given_) return FrameReport(frame);
  const FrameReport report = alignment_->process(frame);
  // Else the IMU's samples before it may be on their way.
  if (fromSeconds(frame.time_offset) == fromSeconds(alignment_->timeOffset()))
    problem_ = tryToStart(frame.stamp);
  return report;
}

/// What diverges, or has a bias that is none, is aligned anew, beside the filter, for some time: at rest an
/// IMU may have any axes, and while it moves little wrong ones pass for right.
void InertialEstimator::verify(const StereoFrame& frame, Divergence divergence) {
  const bool has_diverged = divergence != Divergence::kNone;
  const bool is_biased =
      filter_->accelerometerBias().norm() > kImplausibleBias * config_.inertial.accelerometer_bias_sigma;
  if (has_diverged) ++divergences_;
  if (has_diverged || is_biased) {
    suspect_at_ = frame.stamp;
    if (!alignment_) {
      alignment_ = std::make_unique<InertialAlignment>(config_);
      alignment_->setTimeOffset(filter_->timeOffset());
    }
  }
  if (!alignment_) return;
  if (secondsBetween(suspect_at_, frame.stamp) > kVerification) {
    alignment_.reset();
    divergences_ = 0;
    return;
  }
  alignment_->process(frame);
  if ((divergences_ < kDivergences && !is_biased) || !alignment_->isFull()) return;
  const InertialAlignment::Result aligned = alignment_->align();
  if (aligned.contradicts) {
    contradiction_ = aligned.problem;
  } else if (aligned.state) {
    const Eigen::Vector3d up = filter_->state().world_T_imu.rotation().transpose().col(2);
    const double tilt = std::atan2(up.cross(aligned.up).norm(), up.dot(aligned.up));
    if (tilt > kLargestTilt)
      contradiction_ =
          "gravity is " + rounded(tilt) +
          " rad off the map's vertical (a state that is given must have the z axis upwards; else: " +
          InertialAlignment::kAxes;
  }
}

/// Empty: it has started. Else why not.
std::string InertialEstimator::tryToStart(Stamp now) {
  const InertialAlignment::Result aligned = alignment_->align();
  if (!aligned.state) return aligned.problem;
  if (alignment_->isFull() && secondsBetween(suspect_at_, now) < kPatience) return problem_;
  auto filter = std::make_unique<InvariantEstimator>(config_);
  filter->begin(*aligned.state);
  filter->preset(alignment_->imu());
  filter->startOpen();
  const std::string problem = replay(*filter);
  filter->endStart();
  if (learnClock(*filter)) return "begins anew with the pictures' clock that was found";
  if (!problem.empty()) {
    suspect_at_ = now;
    return "the accelerometer contradicts the pictures once the filter begins: " + problem + " (" +
           InertialAlignment::kAxes;
  }
  if (const auto there = forecast_ ? forecast_(aligned.state->stamp) : std::nullopt)
    filter->moveOrigin(aligned.state->world_T_imu, *there);
  else
    filter->moveOriginHere();
  if (map_) filter->relocaliseIn(map_); // not before the origin is where the map begins
  filter_ = std::move(filter);
  alignment_.reset();
  forecast_ = nullptr; // which holds the filter of before, with its map
  return {};
}

/// Empty: it goes on from there; else why not: a start by a fit that was none, or where it is not linear,
/// does not predict the frames that it is made of. Velocities wait until the tilt is known: its prior is so
/// wide that the noise of one turns the body by a tenth of a radian, and points follow that to first order
/// (Filter::endPeriod).
std::string InertialEstimator::replay(InvariantEstimator& filter) const {
  std::deque<FrameReport> newest;
  const std::deque<Measurement>& window = alignment_->measurements();
  for (auto m = window.begin(); m != window.end(); ++m) {
    const auto next = std::find_if(m, window.end(), InertialAlignment::isImu);
    if (next != window.end()) filter.expect(std::get<ImuSample>(*next));
    if (const auto* frame = std::get_if<StereoFrame>(&*m)) {
      const FrameReport report = filter.process(*frame);
      if (report.divergence != Divergence::kNone) return "it diverges";
      if (report.used + report.rejected_now > 0) newest.push_back(report);
      if (newest.size() > kNewestFrames) newest.pop_front();
    } else if (const auto* sample = std::get_if<ImuSample>(&*m)) {
      filter.process(*sample);
    }
  }
  std::size_t used = 0, rejected = 0;
  for (const FrameReport& report : newest) {
    used += report.used;
    rejected += report.rejected_now;
  }
  const double share =
      static_cast<double>(rejected) / static_cast<double>(std::max<std::size_t>(1, used + rejected));
  if (share <= kLargestRejection) return {};
  return rounded(100.0 * share) + " % of the newest features do not follow, at most " +
         rounded(100.0 * kLargestRejection) + " %";
}

/// All frames of the window were looked at with the clock that was told. Where the filter has found another
/// one, beyond what is linear, they are put where they belong, and the start is not yet. The prior counts as
/// if it had said so, of which little is left in what is known by then.
bool InertialEstimator::learnClock(const InvariantEstimator& filter) {
  const auto rig = filter.rig();
  if (!rig || !(rig->time_offset_sigma < kLearnt * config_.rig.time_offset_sigma)) return false;
  if (std::abs(rig->time_offset - config_.rig.time_offset) < kLinearClock) return false;
  config_.rig.time_offset = rig->time_offset;
  alignment_->setTimeOffset(rig->time_offset);
  return true;
}

void InertialEstimator::relocaliseIn(std::shared_ptr<const SavedMap> map) {
  map_ = map;
  if (filter_) filter_->relocaliseIn(std::move(map));
}

void InertialEstimator::resumeFrom(std::shared_ptr<const SavedMap> map, const std::string& source,
                                   double max_gap_s) {
  auto filter = std::make_unique<InvariantEstimator>(config_);
  filter->resumeFrom(map, source, max_gap_s);
  resuming_ = std::move(filter);
  map_ = std::move(map);
}

} // namespace vi_ekf_slam

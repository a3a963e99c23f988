#include "vi_ekf_slam/ros/node/diagnostics.hpp"

#include <algorithm>

#include "vi_ekf_slam/ros/conversions.hpp"

namespace vi_ekf_slam {
namespace {

using diagnostic_msgs::DiagnosticStatus;

constexpr std::size_t kWindow = 50; // messages
constexpr double kSilence = 2.0;    // s of wall time

} // namespace

void RateMeter::add(Stamp stamp) {
  if (!stamps_.empty() && stamp < stamps_.back()) stamps_.clear();
  stamps_.push_back(stamp);
  if (stamps_.size() > kWindow) stamps_.pop_front();
  last_ = ros::WallTime::now();
}

double RateMeter::rate() const {
  if (stamps_.size() < 2 || stamps_.back() == stamps_.front()) return 0.0;
  return static_cast<double>(stamps_.size() - 1) / secondsBetween(stamps_.front(), stamps_.back());
}

std::optional<double> RateMeter::silence() const {
  if (!last_) return std::nullopt;
  return (ros::WallTime::now() - *last_).toSec();
}

Diagnostics::Diagnostics(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const Sources& sources)
    : from_(sources), updater_(nh, private_nh) {
  updater_.add("inputs", this, &Diagnostics::inputs);
  updater_.add("calibration", this, &Diagnostics::calibration);
  updater_.add("frames", this, &Diagnostics::frames);
  updater_.add("estimator", this, &Diagnostics::estimator);
  updater_.add("divergence", this, &Diagnostics::divergence);
  updater_.add("map", this, &Diagnostics::map);
  updater_.add("results", this, &Diagnostics::results);
  updater_.add("load", this, &Diagnostics::load);
  updater_.add("dropped", this, &Diagnostics::drops);
}

void Diagnostics::noteInput(Stream stream, const ros::Time& stamp, WorkQueue::Clock::time_point arrival) {
  latency_.noteArrival(stream, conversions::toStamp(stamp), arrival);
  rates_[static_cast<std::size_t>(stream)].add(conversions::toStamp(stamp));
  newest_input_ = conversions::toStamp(stamp);
}

void Diagnostics::noteOutput(const Output& output, bool is_frame) {
  newest_output_ = output.state.stamp;
  latency_.noteResult(is_frame ? Stream::kStereo : Stream::kImu,
                      is_frame ? output.frame_stamp : newest_output_);
  if (!is_frame) return;
  last_frame_ = output;
  slowest_update_s_ = std::max(slowest_update_s_, output.update_s);
}

void Diagnostics::inputs(Status& status) {
  status.summary(DiagnosticStatus::OK, "all inputs come in");
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    status.addf(std::string(kTopicNames[i]) + " rate (Hz of sensor time)", "%.2f", rates_[i].rate());
    const auto silence = rates_[i].silence();
    if (silence ? *silence < kSilence : !from_.intake.isRequired(static_cast<Stream>(i))) continue;
    status.mergeSummary(DiagnosticStatus::WARN,
                        std::string(silence ? "silent: " : "nothing yet on ") + kTopicNames[i]);
  }
  const ImuCheck& imu = from_.system.checks().imu;
  status.add("imu intervals that are not the usual one", imu.counts().stutters);
  status.add("imu stamps that went back", imu.counts().backwards);
  status.add("times that imu stopped", imu.counts().stops);
  if (const std::string problem = imu.problem(); !problem.empty())
    status.mergeSummary(DiagnosticStatus::WARN, problem);
  for (const std::string& problem :
       {from_.intake.stereoCheck().problem(), from_.system.checks().motion.problem()}) {
    if (!problem.empty()) status.mergeSummary(DiagnosticStatus::WARN, problem);
  }
}

void Diagnostics::calibration(Status& status) {
  status.add("known", from_.system.hasRig());
  if (from_.system.hasRig()) {
    status.summary(DiagnosticStatus::OK, "known");
    if (const auto rig = from_.system.estimator().rig(); rig && rig->isEstimated()) {
      status.summary(DiagnosticStatus::OK, "estimated");
      status.add("time offset of the camera (s)", rig->time_offset);
      status.add("its sigma (s)", rig->time_offset_sigma);
      status.add("largest sigma of the camera's rotation (rad)", rig->rotation_sigma.maxCoeff());
      status.add("largest sigma of the camera's translation (m)", rig->translation_sigma.maxCoeff());
      status.add("baseline (m)", rig->rig.camera.baseline);
      status.add("its sigma (m)", rig->baseline_sigma);
    }
  } else if (!from_.system.needsRig()) {
    status.summary(DiagnosticStatus::OK, "not needed: the configuration uses no features");
  } else {
    status.summary(DiagnosticStatus::WARN, from_.intake.rigAssembler().problem());
  }
  if (const std::string& changed = from_.intake.rigAssembler().changedLater(); !changed.empty())
    status.summary(DiagnosticStatus::WARN, changed + " has changed; the first calibration stays in use");
}

void Diagnostics::frames(Status& status) {
  status.add("IMU", from_.intake.imuFrame());
  status.add("base", from_.publishers.base().name());
  const std::string problem = from_.publishers.problem();
  if (problem.empty()) {
    status.summary(DiagnosticStatus::OK, "all that is configured is published");
  } else {
    status.summary(DiagnosticStatus::ERROR, problem);
  }
  if (const std::string change = from_.publishers.base().change(); !change.empty())
    status.mergeSummary(DiagnosticStatus::WARN, change);
}

void Diagnostics::estimator(Status& status) {
  const Estimator& estimator = from_.system.estimator();
  status.add("initialised", newest_output_ != 0 && estimator.hasStarted());
  status.add("motion", from_.system.motionText());
  status.add("frames before the start", from_.system.counts().frames_before_start);
  for (const StreamNoise& noise : from_.system.checks().noise.streams())
    status.add("noise of " + noise.stream, toText(noise));
  if (!estimator.hasStarted()) {
    status.summary(DiagnosticStatus::WARN, "not started: " + estimator.startProblem());
    return;
  }
  if (newest_output_ == 0) {
    status.summary(DiagnosticStatus::WARN, "not initialised: no measurement processed yet");
    return;
  }
  status.summary(DiagnosticStatus::OK, "running");
  status.addf("lag behind newest input (s of sensor time)", "%.3f",
              secondsBetween(newest_output_, newest_input_));
  if (!last_frame_) return;
  const FrameReport& r = last_frame_->report;
  status.add("features", r.features);
  status.add("used (inliers)", r.used);
  status.add("rejected", r.rejected);
  status.add("invalid", r.invalid);
  status.add("landmarks", r.landmarks);
  if (r.nis_dof > 0) status.addf("NIS per degree of freedom", "%.3f", r.nis / static_cast<double>(r.nis_dof));
  status.addf("slowest update since last report (ms)", "%.2f", 1e3 * slowest_update_s_);
  slowest_update_s_ = 0.0;
  if (r.frame_rejected) status.summary(DiagnosticStatus::WARN, "the last frame was rejected as a whole");
}

/// An estimate that has just begun anew is an error, or without what it knew a warning; one that does so at
/// each report keeps being one.
void Diagnostics::divergence(Status& status) {
  status.summary(DiagnosticStatus::OK, "consistent");
  const Blindness& blindness = from_.system.blindness();
  status.addf("without a correction by features (s of sensor time)", "%.1f", blindness.current());
  if (blindness.isBlind()) {
    status.summary(DiagnosticStatus::WARN,
                   "loss of vision: no feature corrects the estimate, which is dead reckoning");
  }
  const SystemCounts all = from_.system.counts();
  if (all.resets > reported_.resets)
    status.mergeSummary(DiagnosticStatus::WARN, "begun anew: " + reset_reason_);
  reported_.resets = all.resets;
  const auto& counts = all.divergences;
  std::string reasons;
  for (std::size_t i = 1; i < kDivergenceCount; ++i) {
    status.add(std::string("diverged: ") + kDivergenceNames[i], counts[i]);
    if (counts[i] > reported_.divergences[i])
      reasons += std::string(reasons.empty() ? "" : ", ") + kDivergenceNames[i];
  }
  reported_.divergences = counts;
  if (!reasons.empty()) {
    status.mergeSummary(DiagnosticStatus::ERROR, "diverged and begun anew from where it was: " + reasons);
  }
}

void Diagnostics::map(Status& status) {
  switch (from_.system.estimator().mapUse()) {
    case MapUse::kNone:
      return status.summary(DiagnosticStatus::OK, "begun anew, no map loaded");
    case MapUse::kWaiting:
      return status.summary(DiagnosticStatus::WARN, "not yet relocalised in the earlier map");
    case MapUse::kRelocalised:
      return status.summary(DiagnosticStatus::OK, "relocalised in the earlier map");
    case MapUse::kResumed:
      return status.summary(DiagnosticStatus::OK, "resumed from the saved map");
  }
}

void Diagnostics::results(Status& status) {
  const std::string& problem = from_.results.problem();
  if (!problem.empty()) return status.summary(DiagnosticStatus::ERROR, problem);
  status.summary(DiagnosticStatus::OK, "no autosave has failed");
}

std::map<std::string, std::uint64_t> Diagnostics::allTurnedAway() const {
  auto all = from_.intake.turnedAway();
  const auto note = [&all](const std::string& reason, std::uint64_t count) {
    if (count > 0) all[reason] += count;
  };
  const WorkQueue::Counts queue = from_.queue.counts();
  note("features: message shed, too old for the load", queue.frames_shed);
  note("features: shed, a busy node takes fewer of a message", from_.intake.shedFeatures());
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    note(std::string(kTopicNames[i]) + ": message dropped, the queue is full", queue.overflow[i]);
  }
  return all;
}

void Diagnostics::load(Status& status) {
  const WorkQueue::Counts queue = from_.queue.counts();
  const LatencyMeter::Summary latency = latency_.take();
  const std::uint64_t shed = queue.frames_shed + from_.intake.shedFeatures();
  if (shed > reported_.shed) {
    status.summary(DiagnosticStatus::WARN, "the filter is slower than its input: features are shed");
  } else {
    status.summary(DiagnosticStatus::OK, "keeps up");
  }
  reported_.shed = shed;
  status.add("results since last report", latency.results);
  status.addf("latency, median (ms of wall time)", "%.2f", 1e3 * latency.median_s);
  status.addf("latency, 95 % (ms of wall time)", "%.2f", 1e3 * latency.p95_s);
  status.addf("latency, longest (ms of wall time)", "%.2f", 1e3 * latency.max_s);
  status.add("messages waiting", queue.size);
  status.add("feature messages shed", queue.frames_shed);
  status.add("features shed", from_.intake.shedFeatures());
  status.add("features taken of a message at most", from_.queue.featureLimit());
}

void Diagnostics::drops(Status& status) {
  status.summary(DiagnosticStatus::OK, "counts since start");
  const SystemCounts c = from_.system.counts();
  std::uint64_t drops = 0;
  const auto count = [&](const std::string& reason, std::uint64_t number) {
    status.add(reason, number);
    drops += number;
  };
  for (std::size_t i = 0; i < kStreamCount; ++i) {
    const std::string stream = kTopicNames[i];
    count(stream + ": late", c.late[i]);
    count(stream + ": duplicate", c.duplicate[i]);
    count(stream + ": stamp far ahead of the others", c.ahead[i]);
    count(stream + ": stamp far behind the others", c.behind[i]);
  }
  for (const auto& [reason, number] : allTurnedAway()) count(reason, number);
  status.add("features without disparity", from_.intake.withoutDisparity());
  status.add("frames without calibration", c.frames_without_rig);
  status.add("frames rejected", c.frames_rejected);
  status.add("landmarks revisited", c.landmarks_revisited);
  status.add("places recognised", c.places_recognised);
  status.addf("loss of vision, in all (s of sensor time)", "%.1f", c.blind_s);
  status.add("relocalisations", c.relocalisations);
  status.add("gaps", c.gaps);
  status.add("resets", c.resets);
  if (drops > reported_.drops) {
    status.summary(DiagnosticStatus::WARN,
                   std::to_string(drops - reported_.drops) + " dropped since the last report");
  }
  reported_.drops = drops;
}

} // namespace vi_ekf_slam

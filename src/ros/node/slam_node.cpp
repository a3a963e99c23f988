#include "vi_ekf_slam/ros/node/slam_node.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "vi_ekf_slam/core/sensors/words.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"
#include "vi_ekf_slam/ros/node/told.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kWarningPeriod = 5.0; // s of wall time between warnings
constexpr double kLookPeriod = 1.0;    // s of wall time between two looks for what to warn of

} // namespace

SlamNode::SlamNode(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh)
    : settings_(readNodeSettings(private_nh)),
      maps_(settings_.maps),
      system_(settings_.config.core),
      intake_(system_, settings_.config.ros, resolvedTopics(nh)),
      sequencer_(
          [this](const Output& output, bool is_frame) {
            if (output.report.relocalised) publishers_.reset(); // earlier poses are in another frame
            publishers_.findBase(intake_.imuFrame(), system_.estimator().startPose());
            publishers_.publish(output, is_frame);
            diagnostics_.noteOutput(output, is_frame);
          },
          settings_.config.ros.odometry_rate),
      publishers_(
          nh, settings_.config.ros, settings_.config.core.buffer.max_jump_s, intake_.frames(),
          [this] { return system_.estimator().landmarks(); }, [this] { return system_.estimator().path(); }),
      worker_({settings_.config.ros.max_latency_s, 3 * Subscriptions::kQueueSize,
               settings_.config.ros.max_features}),
      diagnostics_(nh, private_nh, {system_, intake_, publishers_, worker_.queue(), results_}),
      results_(settings_, maps_, system_, worker_, [this] { return summary(); }),
      arrival_check_(settings_.config.core.buffer.max_delay_s),
      subscriptions_(nh, worker_.queue()) {
  connectSystem();
  maps_.begin(system_);
  if (settings_.initial_state) system_.begin(*settings_.initial_state);
  subscribe(nh.resolveName("initialpose"));
  services_ = std::make_unique<Services>(private_nh, settings_.config, actions(), worker_, results_, maps_);
  worker_.start({[this](WorkQueue::Item& item) { process(item); }, [this](bool is_pause) { tend(is_pause); },
                 [this](const std::string& failure) { diagnostics_.fail(failure); }});
  ROS_INFO_STREAM("configured from " << settings_.source << "; "
                                     << (settings_.maps.output_dir.empty()
                                             ? "nothing is saved (~output_dir is empty)"
                                             : "results go to " + settings_.maps.output_dir));
}

SlamNode::~SlamNode() { finish(); }

std::string SlamNode::failure() const {
  const std::string failure = worker_.failure();
  return failure.empty() ? results_.failure() : failure;
}

void SlamNode::connectSystem() {
  system_.onImu([this](const Output& output) { handleOutput(output, false); });
  system_.onFrame([this](const Output& output) { handleOutput(output, true); });
  system_.onNoise([](const StreamNoise& noise) { ROS_INFO_STREAM("noise: " << toText(noise)); });
  system_.onStart([](const std::string& text) { ROS_INFO_STREAM(text); });
  if (!system_.motionText().empty()) ROS_INFO_STREAM("motion: " << system_.motionText());
  system_.onProblem([](const std::string& problem) { ROS_WARN_STREAM(problem); });
  system_.onMapEnd([this](const std::function<SavedMap()>& map) { results_.keepEarlierMap(map); });
  system_.onReset([this](const std::string& reason, const PathEstimate& path) { handleReset(reason, path); });
  intake_.onProblem([](const std::string& problem) { ROS_WARN_STREAM(problem); });
}

template <typename Message>
void SlamNode::listenToMeasurements(const std::string& topic, Stream stream) {
  subscriptions_.listen<Message>(
      topic,
      [this, stream](const Message& message) {
        diagnostics_.noteInput(stream, message.header.stamp, watch_.item_arrival);
        noteArrival(stream, message.header.stamp);
        if (intake_.received() == 0 && subscriptions_.hasPublisher(intake_.topics().twist_bias))
          system_.awaitBiasPrior();
        intake_.add(message);
      },
      stream);
}

/// In the clock of the machine: simulated time says nothing about receipt.
void SlamNode::noteArrival(Stream stream, const ros::Time& stamp) {
  if (ros::Time::isSimTime()) return;
  const auto waited =
      std::chrono::duration_cast<std::chrono::nanoseconds>(WorkQueue::Clock::now() - watch_.item_arrival);
  const auto received = static_cast<Stamp>(ros::Time::now().toNSec()) - static_cast<Stamp>(waited.count());
  const std::string problem = arrival_check_.note(stream, static_cast<Stamp>(stamp.toNSec()), received);
  if (!problem.empty()) ROS_WARN_STREAM(problem);
}

void SlamNode::subscribe(const std::string& pose_topic) {
  using geometry_msgs::PoseWithCovarianceStamped;
  using geometry_msgs::TwistWithCovarianceStamped;
  using sensor_msgs::CameraInfo;
  const InputTopics names; // relative: the node handle resolves and remaps them
  subscriptions_.listenToTransforms([this](const auto& message, bool is_static, bool of_this_process) {
    handleTransforms(message, is_static, of_this_process);
  });
  subscriptions_.listen<CameraInfo>(names.left_info, [this](const auto& m) { intake_.addLeftInfo(m); });
  subscriptions_.listen<CameraInfo>(names.right_info, [this](const auto& m) { intake_.addRightInfo(m); });
  subscriptions_.listen<TwistWithCovarianceStamped>(names.twist_bias,
                                                    [this](const auto& m) { intake_.addTwistBias(m); });
  subscriptions_.listen<PoseWithCovarianceStamped>("initialpose", [this, pose_topic](const auto& m) {
    const std::string problem = setPose(m);
    if (!problem.empty()) ROS_WARN_STREAM(pose_topic << ": " << problem);
  });
  listenToMeasurements<sensor_msgs::Imu>(names.imu, Stream::kImu);
  listenToMeasurements<TwistWithCovarianceStamped>(names.velocity, Stream::kVelocity);
  listenToMeasurements<nav_msgs::Odometry>(names.wheel_odometry, Stream::kVelocity);
  listenToMeasurements<StereoFeatureArray>(names.features, Stream::kStereo);
}

Services::Actions SlamNode::actions() {
  return {[this](const std::string& reason) { system_.reset(reason); },
          [this](std::shared_ptr<const SavedMap> map, const std::string& file) {
            maps_.noteLoaded(file);
            system_.loadMap(std::move(map), file);
          },
          [this](const geometry_msgs::PoseWithCovarianceStamped& pose) { return setPose(pose); },
          [this](const SetState::Request& state) { return setState(state); },
          [this](const TuningConfig& tuning) {
            publishers_.setRates(tuning.path_period_s, tuning.landmark_period_s,
                                 tuning.max_bandwidth_bytes_s);
            system_.setGates(gatesOf(tuning));
          }};
}

void SlamNode::process(WorkQueue::Item& item) {
  watch_.item_arrival = item.arrival;
  intake_.limitFeatures(worker_.queue().featureLimit());
  item.work();
  // Calibration lets go of the measurements that waited for it, so this is due after every kind of item.
  sequencer_.endOfDrain();
}

void SlamNode::tend(bool is_pause) {
  if (is_pause) publishers_.publishUnsent();
  publishers_.serveNewListeners();
  diagnostics_.reportIfDue();
  if (secondsSince(watch_.last_look) >= kLookPeriod && secondsSince(watch_.last_warning) >= kWarningPeriod) {
    watch_.last_look = WorkQueue::Clock::now();
    warn();
  }
  if (intake_.received() > 0) results_.autosaveIfDue();
}

/// What this node sends comes back to it, and is not to be taken for somebody else's.
void SlamNode::handleTransforms(tf2_msgs::TFMessage message, bool is_static, bool of_this_process) {
  auto& transforms = message.transforms;
  if (of_this_process) {
    const auto is_ours = [this](const auto& t) {
      return publishers_.sends(t.header.frame_id, t.child_frame_id);
    };
    transforms.erase(std::remove_if(transforms.begin(), transforms.end(), is_ours), transforms.end());
  }
  intake_.addTransforms(message, is_static);
  publishers_.noteTransforms();
}

void SlamNode::handleOutput(const Output& output, bool is_frame) {
  if (is_frame && output.report.divergence != Divergence::kNone) {
    ROS_ERROR_STREAM(
        "the estimate has diverged ("
        << kDivergenceNames[static_cast<std::size_t>(output.report.divergence)]
        << "); it goes on from where it was, without its landmarks and with a larger covariance");
  }
  if (output.report.relocalised) {
    ROS_INFO_STREAM(
        "relocalised in the earlier map; from now on poses and landmarks are in its frame, and paths start "
        "anew");
    results_.restart();
  }
  sequencer_.add(output, is_frame);
  results_.add(output, is_frame);
}

void SlamNode::handleReset(const std::string& reason, const PathEstimate& path) {
  const bool has_map = system_.estimator().mapUse() == MapUse::kWaiting;
  ROS_WARN_STREAM("reset: " << reason << "; state, map and paths start anew"
                            << (has_map ? ", and the place in the earlier map is looked for" : ""));
  sequencer_.endOfDrain();
  diagnostics_.restart(reason);
  intake_.restartTransforms();
  publishers_.restart();
  results_.restart(path);
}

/// Why nothing was done; empty: it was.
std::string SlamNode::setPose(const geometry_msgs::PoseWithCovarianceStamped& message) {
  const Estimator& estimator = system_.estimator();
  sequencer_.endOfDrain();
  if (!intake_.imuFrame().empty()) {
    if (system_.motion() == MotionChoice::kAuto)
      return "the pose is not set, not started: no measurement has been processed yet";
    if (!estimator.hasStarted()) return "the pose is not set, not started: " + estimator.startProblem();
    publishers_.findBase(intake_.imuFrame(), estimator.startPose());
  }
  const SE3 motion = publishers_.motionSince(conversions::toStamp(message.header.stamp));
  ToldPose told;
  const std::string problem =
      readToldPose(message, settings_.config.ros.map_frame, publishers_.base(), motion, told);
  if (!problem.empty()) return problem;
  const bool was_elsewhere = estimator.mapUse() == MapUse::kWaiting;
  if (!system_.setPose(told.world_T_imu, told.covariance))
    return "the pose is not set: the configured estimator cannot, or its covariance would not be valid";
  ROS_INFO_STREAM("the pose is set" << (was_elsewhere ? ", in the earlier map; paths start anew" : ""));
  if (was_elsewhere) { // earlier poses are in another frame
    publishers_.reset();
    results_.restart();
  }
  return {};
}

/// Why nothing was done; empty: it was.
std::string SlamNode::setState(const SetState::Request& request) {
  if (system_.motion() == MotionChoice::kConstantTwist)
    return "the state is not set: the motion is a constant twist, it must be inertial";
  sequencer_.endOfDrain();
  if (!publishers_.findBase(intake_.imuFrame(), std::nullopt))
    return publishers_.problem().empty() ? "the IMU's frame is not known yet: no imu message has come"
                                         : publishers_.problem();
  InitialState state;
  const std::string problem =
      readToldState(request, settings_.config.ros.map_frame, publishers_.base(), state);
  if (!problem.empty()) return problem;
  const double limit = settings_.config.core.buffer.max_gap_s;
  if (const auto newest = system_.newest()) {
    const double ahead = secondsBetween(*newest, state.stamp);
    if (!(std::abs(ahead) <= limit))
      return "header.stamp is " + std::to_string(ahead) +
             " s after the newest measurement, allowed: " + std::to_string(limit) +
             " s (buffer/max_gap_s) before to after it";
  }
  system_.reset("a state is set");
  system_.begin(state);
  return {};
}

void SlamNode::warn() {
  std::string warning;
  const auto add = [&warning](const std::string& text) { addProblem(warning, text); };
  if (const std::string missing = intake_.missingInputs(); !missing.empty())
    add("no message yet on " + missing);
  if (intake_.received() == 0) {
    // what calibration lacks is not the point yet
  } else if (system_.needsRig() && !system_.hasRig()) {
    add("features are not used: " + intake_.rigAssembler().problem());
  } else if (const std::string& changed = intake_.rigAssembler().changedLater(); !changed.empty()) {
    add(changed + " has changed; the first calibration stays in use until a restart");
  }
  if (system_.counts().frames_before_start > 0 && !system_.estimator().hasStarted())
    add("no pose is published yet, not started: " + system_.estimator().startProblem());
  for (const std::string& text : {publishers_.problem(), publishers_.base().change()}) {
    if (!text.empty()) add(text);
  }
  const auto turned_away = diagnostics_.allTurnedAway();
  if (turned_away != watch_.warned_turned_away) {
    watch_.warned_turned_away = turned_away;
    for (const auto& [reason, count] : turned_away)
      add("turned away: " + reason + ": " + std::to_string(count));
  }
  if (warning.empty()) return;
  watch_.last_warning = WorkQueue::Clock::now();
  ROS_WARN_STREAM(warning);
}

RunSummary SlamNode::summary() const {
  RunSummary summary(system_);
  summary.input = "topics";
  summary.config = settings_.source;
  summary.wall_s = secondsSince(watch_.start);
  summary.turned_away = diagnostics_.allTurnedAway();
  summary.body = intake_.imuFrame();
  return summary;
}

void SlamNode::finish() {
  if (!services_) return;
  subscriptions_.shutdown();
  worker_.stop();
  services_.reset();
  try {
    if (failure().empty()) {
      intake_.flush();
      system_.flush();
      sequencer_.endOfDrain();
      publishers_.publishAll();
    }
  } catch (const std::exception& e) {
    ROS_ERROR_STREAM("the last measurements are not processed: " << e.what());
  }
  if (intake_.received() > 0) {
    results_.saveAtTheEnd();
  } else if (!settings_.maps.output_dir.empty()) { // leaves what an earlier run has saved there
    ROS_WARN_STREAM("no measurement has come: nothing is saved");
  }
}

} // namespace vi_ekf_slam

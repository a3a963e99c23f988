#include "vi_ekf_slam/ros/node/slam_node.hpp"

#include <algorithm>
#include <utility>

#include "vi_ekf_slam/ros/conversions.hpp"
#include "vi_ekf_slam/ros/node/told_pose.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kWarningPeriod = 5.0;       // s of wall time between warnings
constexpr std::uint32_t kInputQueue = 10000; // messages an input; deep, so that a busy machine loses nothing

} // namespace

InputTopics SlamNode::resolvedTopics() const {
  InputTopics topics;
  for (std::string* name : {&topics.imu, &topics.velocity, &topics.wheel_odometry, &topics.twist_bias,
                            &topics.features, &topics.left_info, &topics.right_info}) {
    *name = nh_.resolveName(*name);
  }
  return topics;
}

SlamNode::SlamNode(ros::NodeHandle nh, ros::NodeHandle private_nh)
    : nh_(std::move(nh)),
      settings_(readNodeSettings(private_nh)),
      maps_(settings_.maps),
      system_(settings_.config.core),
      intake_(system_, settings_.config.ros, resolvedTopics()),
      sequencer_([this](const Output& output, bool is_frame) {
        if (output.report.relocalised) publishers_.reset(); // earlier poses are in another frame
        publishers_.publish(output, is_frame, intake_.imuFrame());
        diagnostics_.noteOutput(output, is_frame);
      }),
      publishers_(nh_, settings_.config.ros, settings_.config.core.buffer.max_jump_s, intake_.frames(),
                  [this] { return system_.estimator().landmarks(); }),
      load_(settings_.config.ros.max_features, settings_.config.ros.max_latency_s),
      worker_({settings_.config.ros.max_latency_s, 3 * kInputQueue}),
      diagnostics_(nh_, private_nh, {system_, intake_, publishers_, worker_.queue(), load_}),
      results_(settings_, maps_, system_, worker_, [this] { return summary(); }) {
  connectSystem();
  maps_.begin(system_);
  subscribe();
  services_ = std::make_unique<Services>(private_nh, settings_.config, actions(), worker_, results_, maps_);
  worker_.start({[this](WorkQueue::Item& item) { process(item); }, [this](bool is_pause) { tend(is_pause); },
                 [this](const std::string& failure) { diagnostics_.fail(failure); }});
  ROS_INFO_STREAM("configured from " << settings_.source << "; "
                                     << (settings_.output_dir.empty()
                                             ? "nothing is saved (~output_dir is empty)"
                                             : "results go to " + settings_.output_dir));
}

SlamNode::~SlamNode() { finish(); }

std::string SlamNode::failure() const {
  const std::string failure = worker_.failure();
  return failure.empty() ? results_.failure() : failure;
}

void SlamNode::connectSystem() {
  system_.onGyro([this](const Output& output) { handleOutput(output, false); });
  system_.onFrame([this](const Output& output) { handleOutput(output, true); });
  system_.onNoise([](const StreamNoise& noise) { ROS_INFO_STREAM("noise: " << toText(noise)); });
  system_.onReset([this](const std::string& reason) { handleReset(reason); });
  intake_.onProblem([](const std::string& problem) { ROS_WARN_STREAM(problem); });
}

template <typename Message>
void SlamNode::listen(const std::string& topic, std::function<void(const Message&)> process,
                      std::optional<Stream> stream) {
  const boost::function<void(const boost::shared_ptr<const Message>&)> callback =
      [this, process, stream](const boost::shared_ptr<const Message>& message) {
        worker_.queue().push([process, message] { process(*message); }, stream);
      };
  subscribers_.push_back(nh_.subscribe<Message>(topic, kInputQueue, callback, ros::VoidConstPtr(),
                                                ros::TransportHints().tcpNoDelay()));
}

template <typename Message>
void SlamNode::listenToMeasurements(const std::string& topic, Stream stream) {
  listen<Message>(
      topic,
      [this, stream](const Message& message) {
        diagnostics_.noteInput(stream, message.header.stamp, watch_.item_arrival);
        intake_.add(message);
      },
      stream);
}

void SlamNode::listenToTransforms(const std::string& topic, bool is_static) {
  using Event = ros::MessageEvent<const tf2_msgs::TFMessage>;
  const boost::function<void(const Event&)> callback = [this, is_static](const Event& event) {
    const bool of_this_process = event.getPublisherName() == ros::this_node::getName();
    worker_.queue().push(
        [this, is_static, of_this_process, message = event.getConstMessage()] {
          handleTransforms(*message, is_static, of_this_process);
        },
        {});
  };
  ros::SubscribeOptions options;
  options.initByFullCallbackType<const Event&>(topic, kInputQueue, callback);
  options.transport_hints = ros::TransportHints().tcpNoDelay();
  subscribers_.push_back(nh_.subscribe(options));
}

void SlamNode::subscribe() {
  using geometry_msgs::PoseWithCovarianceStamped;
  using geometry_msgs::TwistWithCovarianceStamped;
  using sensor_msgs::CameraInfo;
  const InputTopics names; // relative: the node handle resolves and remaps them
  listenToTransforms("/tf_static", true);
  listenToTransforms("/tf", false);
  listen<CameraInfo>(names.left_info, [this](const CameraInfo& m) { intake_.addLeftInfo(m); }, {});
  listen<CameraInfo>(names.right_info, [this](const CameraInfo& m) { intake_.addRightInfo(m); }, {});
  listen<TwistWithCovarianceStamped>(names.twist_bias, [this](const auto& m) { intake_.addTwistBias(m); },
                                     {});
  listen<PoseWithCovarianceStamped>("initialpose",
                                    [this](const auto& m) {
                                      const std::string problem = setPose(m);
                                      if (!problem.empty())
                                        ROS_WARN_STREAM(nh_.resolveName("initialpose") << ": " << problem);
                                    },
                                    {});
  listenToMeasurements<sensor_msgs::Imu>(names.imu, Stream::kGyro);
  listenToMeasurements<TwistWithCovarianceStamped>(names.velocity, Stream::kVelocity);
  listenToMeasurements<nav_msgs::Odometry>(names.wheel_odometry, Stream::kVelocity);
  listenToMeasurements<StereoFeatureArray>(names.features, Stream::kStereo);
}

Services::Actions SlamNode::actions() {
  return {[this](const std::string& reason) { system_.reset(reason); },
          [this](std::shared_ptr<const SavedMap> map, const std::string& file) {
            system_.loadMap(std::move(map), file);
            maps_.noteLoaded(file);
          },
          [this](const geometry_msgs::PoseWithCovarianceStamped& pose) { return setPose(pose); },
          [this](const TuningConfig& tuning) {
            publishers_.setRates(tuning.path_period_s, tuning.landmark_period_s,
                                 tuning.max_bandwidth_bytes_s);
            system_.setGates(gatesOf(tuning));
          }};
}

void SlamNode::process(WorkQueue::Item& item) {
  watch_.item_arrival = item.arrival;
  if (item.stream == Stream::kStereo) {
    load_.noteFrame(secondsSince(item.arrival));
    intake_.limitFeatures(load_.limit());
  }
  item.work();
  // Calibration lets go of the measurements that waited for it, so this is due after every kind of item.
  sequencer_.endOfDrain();
}

void SlamNode::tend(bool is_pause) {
  if (is_pause) publishers_.publishUnsent();
  publishers_.serveNewListeners();
  if (secondsSince(watch_.last_report) < diagnostics_.period()) return;
  watch_.last_report = WorkQueue::Clock::now();
  diagnostics_.publish();
  if (secondsSince(watch_.last_warning) >= kWarningPeriod) warn();
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
        "relocalised in the loaded map; from now on poses and landmarks are in its frame, and paths start "
        "anew");
    results_.restart();
  }
  if (is_frame) {
    sequencer_.addFrame(output);
  } else {
    sequencer_.addGyro(output);
  }
  results_.add(output, is_frame);
}

void SlamNode::handleReset(const std::string& reason) {
  ROS_WARN_STREAM("reset: " << reason << "; state, map and paths start anew");
  sequencer_.endOfDrain();
  diagnostics_.restart();
  intake_.restartTransforms();
  publishers_.restart();
  results_.restart();
}

/// Why nothing was done; empty: it was.
std::string SlamNode::setPose(const geometry_msgs::PoseWithCovarianceStamped& message) {
  sequencer_.endOfDrain();
  const SE3 motion = publishers_.motionSince(conversions::toStamp(message.header.stamp));
  ToldPose told;
  const std::string problem =
      readToldPose(message, settings_.config.ros.map_frame, publishers_.base(), motion, told);
  if (!problem.empty()) return problem;
  const bool was_elsewhere = system_.estimator().mapUse() == MapUse::kWaiting;
  if (!system_.setPose(told.world_T_imu, told.covariance))
    return "the pose is not set: the configured estimator cannot, or its covariance would not be valid";
  ROS_INFO_STREAM("the pose is set" << (was_elsewhere ? ", in the loaded map; paths start anew" : ""));
  if (was_elsewhere) { // earlier poses are in another frame
    publishers_.reset();
    results_.restart();
  }
  return {};
}

void SlamNode::warn() {
  std::string warning;
  const auto add = [&warning](const std::string& text) { warning += (warning.empty() ? "" : "; ") + text; };
  if (const std::string missing = intake_.missingInputs(); !missing.empty())
    add("no message yet on " + missing);
  if (intake_.received() == 0) {
    // what calibration lacks is not the point yet
  } else if (system_.needsRig() && !system_.hasRig()) {
    add("features are not used, dead reckoning only: " + intake_.rigAssembler().problem());
  } else if (intake_.rigAssembler().changedLater()) {
    add("camera_info has changed; the first calibration stays in use until a restart");
  }
  if (const std::string unpublished = publishers_.problem(); !unpublished.empty()) add(unpublished);
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
  return {"topics",
          settings_.source,
          secondsSince(watch_.start),
          system_.counts(),
          diagnostics_.allTurnedAway(),
          system_.noise().streams()};
}

void SlamNode::finish() {
  if (!services_) return;
  for (ros::Subscriber& subscriber : subscribers_) subscriber.shutdown();
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
  } else if (!settings_.output_dir.empty()) { // leaves what an earlier run has saved there
    ROS_WARN_STREAM("no measurement has come: nothing is saved");
  }
}

} // namespace vi_ekf_slam

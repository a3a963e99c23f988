#include "vi_ekf_slam/ros/slam_node.hpp"

#include <utility>

namespace vi_ekf_slam {
namespace {

constexpr double kWarningPeriod = 5.0;       // s of wall time between warnings
constexpr double kIdlePeriod = 0.05;         // s that the worker waits for a message
constexpr int kPause = 4;                    // such waits in vain, from which on paths are sent whole
constexpr double kDrainLimit = 8.0;          // s; roslaunch waits 15 s between SIGINT and SIGTERM
constexpr std::uint32_t kInputQueue = 10000; // messages an input; deep, so that a busy machine loses nothing

} // namespace

InputTopics SlamNode::resolvedTopics(const ros::NodeHandle& nh) {
  InputTopics topics;
  for (std::string* name :
       {&topics.imu, &topics.velocity, &topics.features, &topics.left_info, &topics.right_info}) {
    *name = nh.resolveName(*name);
  }
  return topics;
}

SlamNode::SlamNode(ros::NodeHandle nh, ros::NodeHandle private_nh)
    : nh_(std::move(nh)),
      private_nh_(std::move(private_nh)),
      settings_(readSettings(private_nh_)),
      maps_(settings_.maps),
      system_(settings_.config.core),
      intake_(system_, settings_.config.ros, resolvedTopics(nh_)),
      sequencer_([this](const Output& output, bool is_frame) {
        if (output.report.relocalised) publishers_.reset(); // earlier poses are in another frame
        publishers_.publish(output, is_frame, intake_.imuFrame());
        diagnostics_.noteOutput(output, is_frame);
      }),
      publishers_(nh_, settings_.config.ros, settings_.config.core.buffer.max_jump_back_s,
                  [this] { return system_.estimator().landmarks(); }),
      diagnostics_(nh_, private_nh_, {system_, intake_, queue_, load_}),
      load_(settings_.config.ros.max_features, settings_.config.ros.max_latency_s),
      queue_({settings_.config.ros.max_latency_s, 3 * kInputQueue}) {
  connectSystem();
  maps_.begin(system_);
  subscribe();
  advertiseServices();
  worker_ = std::thread(&SlamNode::work, this); // last: nothing that may throw comes after it
  ROS_INFO_STREAM("configured from " << settings_.source << "; "
                                     << (settings_.output_dir.empty()
                                             ? "nothing is saved (~output_dir is empty)"
                                             : "results go to " + settings_.output_dir));
}

SlamNode::~SlamNode() { finish(); }

void SlamNode::connectSystem() {
  system_.onGyro([this](const Output& output) { handleOutput(output, false); });
  system_.onFrame([this](const Output& output) { handleOutput(output, true); });
  system_.onNoise([](const StreamNoise& noise) { ROS_INFO_STREAM("noise: " << toText(noise)); });
  system_.onReset([this](const std::string& reason) { handleReset(reason); });
}

template <typename Message>
void SlamNode::listen(const std::string& topic, std::function<void(const Message&)> process,
                      std::optional<Stream> stream, const std::atomic<bool>* wanted) {
  const boost::function<void(const boost::shared_ptr<const Message>&)> callback =
      [this, process, stream, wanted](const boost::shared_ptr<const Message>& message) {
        if (wanted != nullptr && !*wanted) return;
        queue_.push([process, message] { process(*message); }, stream);
      };
  subscribers_.push_back(nh_.subscribe<Message>(topic, kInputQueue, callback, ros::VoidConstPtr(),
                                                ros::TransportHints().tcpNoDelay()));
}

template <typename Message>
void SlamNode::listenToMeasurements(const std::string& topic, Stream stream) {
  listen<Message>(
      topic,
      [this, stream](const Message& message) {
        diagnostics_.noteInput(stream, message.header.stamp, item_arrival_);
        intake_.add(message);
      },
      stream);
}

void SlamNode::subscribe() {
  using sensor_msgs::CameraInfo;
  using tf2_msgs::TFMessage;
  const InputTopics names; // relative: the node handle resolves and remaps them
  listen<TFMessage>("/tf_static", [this](const TFMessage& m) { intake_.addTransforms(m, true); }, {});
  listen<TFMessage>(
      "/tf", [this](const TFMessage& m) { intake_.addTransforms(m, false); }, {}, &transforms_wanted_);
  listen<CameraInfo>(names.left_info, [this](const CameraInfo& m) { intake_.addLeftInfo(m); }, {});
  listen<CameraInfo>(names.right_info, [this](const CameraInfo& m) { intake_.addRightInfo(m); }, {});
  listen<geometry_msgs::TwistWithCovarianceStamped>(names.twist_bias,
                                                    [this](const auto& m) { intake_.addTwistBias(m); }, {});
  listenToMeasurements<sensor_msgs::Imu>(names.imu, Stream::kGyro);
  listenToMeasurements<geometry_msgs::TwistWithCovarianceStamped>(names.velocity, Stream::kVelocity);
  listenToMeasurements<StereoFeatureArray>(names.features, Stream::kStereo);
}

void SlamNode::work() {
  try {
    int idle = 0;
    while (!abandon_) {
      auto item = queue_.pop(kIdlePeriod);
      idle = item ? 0 : idle + 1;
      if (item) process(*item);
      if (idle >= kPause) publishers_.publishUnsent();
      if (!item && queue_.closed()) return;
      publishers_.serveNewListeners();
      checkHealth();
    }
  } catch (const std::exception& e) {
    ROS_FATAL_STREAM("the computing has ended: " << e.what());
    queue_.close();
    queue_.clear();
    const std::lock_guard<std::mutex> lock(failure_mutex_);
    failure_ = std::string("the computing has ended: ") + e.what();
  }
}

void SlamNode::process(WorkQueue::Item& item) {
  item_arrival_ = item.arrival;
  if (item.stream == Stream::kStereo) {
    load_.noteFrame(secondsSince(item.arrival));
    intake_.limitFeatures(load_.limit());
  }
  item.work();
  // Calibration lets go of the measurements that waited for it, so this is due after every kind of item.
  sequencer_.endOfDrain();
  transforms_wanted_ = system_.needsRig() && !system_.hasRig();
}

std::string SlamNode::failure() const {
  const std::lock_guard<std::mutex> lock(failure_mutex_);
  return failure_;
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
    writer_.restart();
  }
  if (is_frame) {
    sequencer_.addFrame(output);
  } else {
    sequencer_.addGyro(output);
  }
  if (settings_.output_dir.empty()) return;
  if (is_frame) {
    writer_.addFrame(output);
  } else {
    writer_.addGyro(output);
  }
}

void SlamNode::handleReset(const std::string& reason) {
  ROS_WARN_STREAM("reset: " << reason << "; state, map and paths start anew");
  sequencer_.endOfDrain();
  diagnostics_.restart();
  publishers_.reset();
  writer_.restart();
}

void SlamNode::checkHealth() {
  // By wall time, because the simulated clock of a bag may stand still.
  if (secondsSince(last_health_) < diagnostics_.period()) return;
  last_health_ = WorkQueue::Clock::now();
  diagnostics_.publish();
  if (secondsSince(last_warning_) >= kWarningPeriod) warn();
  if (isAutosaveDue()) autosave();
}

void SlamNode::warn() {
  std::string warning;
  if (const std::string missing = intake_.missingInputs(); !missing.empty()) {
    warning = "no message yet on " + missing;
  }
  if (intake_.received() == 0) {
    // what calibration lacks is not the point yet
  } else if (system_.needsRig() && !system_.hasRig()) {
    warning += (warning.empty() ? "" : "; ") + std::string("features are not used, dead reckoning only: ") +
               intake_.rigAssembler().problem();
  } else if (intake_.rigAssembler().changedLater()) {
    warning += (warning.empty() ? "" : "; ") +
               std::string("camera_info has changed; the first calibration stays in use until a restart");
  }
  const auto turned_away = diagnostics_.allTurnedAway();
  if (turned_away != warned_turned_away_) {
    warned_turned_away_ = turned_away;
    for (const auto& [reason, count] : warned_turned_away_) {
      warning +=
          (warning.empty() ? "turned away: " : "; turned away: ") + reason + ": " + std::to_string(count);
    }
  }
  if (warning.empty()) return;
  last_warning_ = WorkQueue::Clock::now();
  ROS_WARN_STREAM(warning);
}

void SlamNode::stopWork() {
  for (ros::Subscriber& subscriber : subscribers_) subscriber.shutdown();
  queue_.close();
  const auto start = WorkQueue::Clock::now();
  while (queue_.counts().size > 0 && secondsSince(start) < kDrainLimit) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const std::size_t lost = queue_.clear();
  if (lost > 0) ROS_WARN_STREAM("stopped before " << lost << " messages that had come were processed");
  abandon_ = true;
  if (worker_.joinable()) worker_.join();
  for (ros::ServiceServer& service : services_) service.shutdown();
  service_spinner_.stop();
  tuning_.reset();
  if (autosave_.valid()) autosave_.wait();
}

void SlamNode::finish() {
  if (finished_) return;
  finished_ = true;
  stopWork();
  try {
    if (failure().empty()) {
      system_.flush();
      sequencer_.endOfDrain();
      publishers_.publishAll();
    }
    if (settings_.output_dir.empty()) return;
    if (intake_.received() == 0) { // leaves what an earlier run has saved there
      ROS_WARN_STREAM("no measurement has come: nothing is saved");
      return;
    }
    save(writer_, settings_.output_dir, summary(), system_.estimator().landmarks());
    // Takes longer: who ends the node may not wait for it.
    RunWriter::writeMap(settings_.output_dir, system_.estimator().exactLandmarks());
    if (const auto map = mapToKeep()) maps_.write(map);
    ROS_INFO_STREAM("saved " << writer_.size() << " poses in " << settings_.output_dir);
  } catch (const std::exception& e) {
    ROS_ERROR_STREAM("not saved: " << e.what());
    const std::lock_guard<std::mutex> lock(failure_mutex_);
    failure_ = std::string("not saved: ") + e.what();
  }
}

} // namespace vi_ekf_slam

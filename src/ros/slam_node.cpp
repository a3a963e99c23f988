#include "vi_ekf_slam/ros/slam_node.hpp"

#include <cstdlib>
#include <filesystem>
#include <utility>

#include "vi_ekf_slam/ros/xmlrpc_yaml.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kHealthPeriod = 1.0;  // s of wall time
constexpr double kWarningPeriod = 5.0; // s of wall time between warnings

/// Absolute, with a leading ~ replaced by the home directory.
std::string absolutePath(const std::string& path) {
  if (path.empty()) return path;
  const char* home = std::getenv("HOME");
  const bool from_home = home != nullptr && (path == "~" || path.rfind("~/", 0) == 0);
  return std::filesystem::absolute(from_home ? home + path.substr(1) : path).string();
}

} // namespace

SlamNode::Settings SlamNode::readSettings(const ros::NodeHandle& private_nh) {
  Settings settings;
  settings.source = "parameters of " + private_nh.getNamespace();
  XmlRpc::XmlRpcValue tree;
  std::string yaml;
  if (private_nh.getParam(private_nh.getNamespace(), tree) &&
      tree.getType() == XmlRpc::XmlRpcValue::TypeStruct) {
    // diagnostic_period is diagnostic_updater's.
    yaml = toYaml(tree, {"output_dir", "diagnostic_period"});
  }
  settings.config = parseFullConfig(yaml, settings.source);
  if (private_nh.hasParam("output_dir") && !private_nh.getParam("output_dir", settings.output_dir)) {
    throw ConfigError(settings.source + ": output_dir must be a string: a folder, or empty to save nothing");
  }
  settings.output_dir = absolutePath(settings.output_dir);
  if (!settings.output_dir.empty()) RunWriter::makeDirectory(settings.output_dir);
  return settings;
}

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
      system_(settings_.config.core),
      intake_(system_, settings_.config.ros, resolvedTopics(nh_)),
      sequencer_([this](const Output& output, bool is_frame) {
        publishers_.publish(output, is_frame, intake_.imuFrame());
        diagnostics_.noteOutput(output, is_frame);
      }),
      publishers_(nh_, settings_.config.ros, settings_.config.core.buffer.max_jump_back_s,
                  [this] { return system_.estimator().landmarks(); }),
      diagnostics_(nh_, private_nh_, system_, intake_),
      start_(ros::WallTime::now()),
      last_warning_(start_) {
  connectSystem();
  subscribe();
  services_ = {private_nh_.advertiseService("reset", &SlamNode::serveReset, this),
               private_nh_.advertiseService("save_trajectory", &SlamNode::serveSaveTrajectory, this),
               private_nh_.advertiseService("save_map", &SlamNode::serveSaveMap, this)};
  health_timer_ = nh_.createWallTimer(ros::WallDuration(kHealthPeriod), &SlamNode::checkHealth, this);
  ROS_INFO_STREAM("configured from " << settings_.source << "; "
                                     << (settings_.output_dir.empty()
                                             ? "nothing is saved (~output_dir is empty)"
                                             : "results go to " + settings_.output_dir));
}

SlamNode::~SlamNode() { finish(); }

void SlamNode::connectSystem() {
  system_.onGyro([this](const Output& output) { handleOutput(output, false); });
  system_.onFrame([this](const Output& output) { handleOutput(output, true); });
  system_.onReset([this](const std::string& reason) { handleReset(reason); });
}

template <typename Message>
void SlamNode::takeMeasurement(const Message& message, Stream stream) {
  diagnostics_.noteInput(stream, message.header.stamp);
  intake_.add(message);
  sequencer_.endOfDrain();
}

void SlamNode::onImu(const sensor_msgs::Imu& message) { takeMeasurement(message, Stream::kGyro); }

void SlamNode::onVelocity(const geometry_msgs::TwistWithCovarianceStamped& message) {
  takeMeasurement(message, Stream::kVelocity);
}

void SlamNode::onFeatures(const StereoFeatureArray& message) { takeMeasurement(message, Stream::kStereo); }

// The last piece of the calibration lets go of the measurements that waited for it, hence endOfDrain.

void SlamNode::onLeftInfo(const sensor_msgs::CameraInfo& message) {
  intake_.addLeftInfo(message);
  sequencer_.endOfDrain();
}

void SlamNode::onRightInfo(const sensor_msgs::CameraInfo& message) {
  intake_.addRightInfo(message);
  sequencer_.endOfDrain();
}

void SlamNode::onTransforms(const tf2_msgs::TFMessage& message) {
  intake_.addTransforms(message, false);
  sequencer_.endOfDrain();
}

void SlamNode::onStaticTransforms(const tf2_msgs::TFMessage& message) {
  intake_.addTransforms(message, true);
  sequencer_.endOfDrain();
}

void SlamNode::subscribe() {
  const auto queue = static_cast<std::uint32_t>(settings_.config.ros.input_queue_size);
  const auto listen = [&](const char* topic, auto callback) {
    subscribers_.push_back(nh_.subscribe(topic, queue, callback, this, ros::TransportHints().tcpNoDelay()));
  };
  const InputTopics names; // relative: the node handle resolves and remaps them
  listen("/tf_static", &SlamNode::onStaticTransforms);
  listen("/tf", &SlamNode::onTransforms);
  listen(names.left_info.c_str(), &SlamNode::onLeftInfo);
  listen(names.right_info.c_str(), &SlamNode::onRightInfo);
  listen(names.imu.c_str(), &SlamNode::onImu);
  listen(names.velocity.c_str(), &SlamNode::onVelocity);
  listen(names.features.c_str(), &SlamNode::onFeatures);
}

void SlamNode::handleOutput(const Output& output, bool is_frame) {
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
  publishers_.reset();
  writer_.restart();
}

void SlamNode::checkHealth(const ros::WallTimerEvent& /*event*/) {
  diagnostics_.publish();
  const ros::WallTime now = ros::WallTime::now();
  // By wall time, because the simulated clock of a bag may stand still.
  if ((now - last_warning_).toSec() < kWarningPeriod) return;
  std::string warning;
  if (intake_.received() == 0) {
    warning = "no message yet on " + nh_.resolveName("imu") + ", " + nh_.resolveName("velocity") + " or " +
              nh_.resolveName("features");
  } else if (system_.needsRig() && !system_.hasRig()) {
    warning = "features are not used, dead reckoning only: " + intake_.rigAssembler().problem();
  } else if (intake_.rigAssembler().changedLater()) {
    warning = "camera_info has changed; the first calibration stays in use until a restart";
  }
  if (intake_.turnedAway() != warned_turned_away_) {
    warned_turned_away_ = intake_.turnedAway();
    for (const auto& [reason, count] : warned_turned_away_) {
      warning +=
          (warning.empty() ? "turned away: " : "; turned away: ") + reason + ": " + std::to_string(count);
    }
  }
  if (warning.empty()) return;
  last_warning_ = now;
  ROS_WARN_STREAM(warning);
}

void SlamNode::finish() {
  if (finished_) return;
  finished_ = true;
  system_.flush();
  sequencer_.endOfDrain();
  publishers_.publishMap();
  if (settings_.output_dir.empty()) return;
  try {
    save();
    ROS_INFO_STREAM("saved " << writer_.size() << " poses in " << settings_.output_dir);
  } catch (const std::exception& e) {
    ROS_ERROR_STREAM("not saved: " << e.what());
  }
}

void SlamNode::save() {
  const auto landmarks = system_.estimator().landmarks();
  const double wall_s = (ros::WallTime::now() - start_).toSec();
  writer_.writeTrajectory(settings_.output_dir);
  writer_.writeMap(settings_.output_dir, landmarks);
  writer_.writeSummary(settings_.output_dir,
                       {"topics", settings_.source, wall_s, system_.counts(), intake_.turnedAway()},
                       landmarks.size());
}

bool SlamNode::saveService(const std::function<void()>& write, std_srvs::Trigger::Response& response) const {
  response.success = 0;
  if (settings_.output_dir.empty()) {
    response.message = "nothing saved: set " + private_nh_.resolveName("output_dir") + " and restart";
    return true;
  }
  try {
    write();
    response.success = 1;
    response.message = "saved in " + settings_.output_dir;
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

bool SlamNode::serveReset(std_srvs::Empty::Request& /*request*/, std_srvs::Empty::Response& /*response*/) {
  system_.reset("asked for by " + private_nh_.resolveName("reset"));
  return true;
}

bool SlamNode::serveSaveTrajectory(std_srvs::Trigger::Request& /*request*/,
                                   std_srvs::Trigger::Response& response) {
  return saveService([this] { writer_.writeTrajectory(settings_.output_dir); }, response);
}

bool SlamNode::serveSaveMap(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  return saveService([this] { writer_.writeMap(settings_.output_dir, system_.estimator().landmarks()); },
                     response);
}

} // namespace vi_ekf_slam

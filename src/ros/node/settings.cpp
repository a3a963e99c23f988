#include "vi_ekf_slam/ros/node/settings.hpp"

#include <cstdlib>
#include <filesystem>
#include <set>

#include "vi_ekf_slam/core/run/calibration_files.hpp"
#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/node/tuning.hpp"
#include "vi_ekf_slam/ros/node/xmlrpc_yaml.hpp"

namespace vi_ekf_slam {

std::string absolutePath(const std::string& path) {
  if (path.empty()) return path;
  const char* home = std::getenv("HOME");
  const bool from_home = home != nullptr && (path == "~" || path.rfind("~/", 0) == 0);
  return std::filesystem::absolute(from_home ? home + path.substr(1) : path).string();
}

namespace {

/// Of slam.launch: the file that the configuration among the parameters is from.
constexpr const char* kConfigFile = "config_file";

/// Parameters that others keep below our name (a launch file's, a nodelet manager's) are no reason not to
/// start; a misspelled one of ours is seen.
void warnOfForeign(const ros::NodeHandle& private_nh, std::set<std::string> names,
                   const std::set<std::string>& known) {
  for (const std::string& name : known) names.erase(name);
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + private_nh.resolveName(name);
  if (!list.empty()) ROS_WARN_STREAM("not read, since the node knows no such parameter: " << list);
}

/// `least`: the value 0 and what it stands for.
void readPeriod(const ros::NodeHandle& private_nh, const std::string& name, const std::string& least,
                double& seconds) {
  if (!private_nh.hasParam(name)) return;
  if (!private_nh.getParam(name, seconds) || !(seconds >= 0.0 && seconds <= 1e6))
    throw ConfigError("parameters of " + private_nh.getNamespace() + ": " + name +
                      " must be a number of seconds from " + least + " to 1e6");
}

} // namespace

void requireDiagnosticPeriod(const ros::NodeHandle& private_nh) {
  double seconds = 0.0;
  readPeriod(private_nh, kDiagnosticPeriod, "0", seconds);
}

FullConfig readConfiguration(const ros::NodeHandle& private_nh, const std::set<std::string>& known) {
  XmlRpc::XmlRpcValue tree;
  YAML::Node configuration(YAML::NodeType::Map);
  if (private_nh.getParam(private_nh.getNamespace(), tree) &&
      tree.getType() == XmlRpc::XmlRpcValue::TypeStruct) {
    std::set<std::string> not_configuration;
    for (const auto& [name, value] : tree) {
      if (isConfigurationKey(name)) {
        configuration[name] = toYaml(value);
      } else {
        not_configuration.insert(name);
      }
    }
    not_configuration.erase(kConfigFile);
    warnOfForeign(private_nh, not_configuration, known);
  }
  std::string file;
  private_nh.getParam(kConfigFile, file);
  file.erase(file.find_last_not_of(" \n") + 1); // a command's output
  return parseFullConfig(configuration, "parameters of " + private_nh.getNamespace(),
                         std::filesystem::path(file).parent_path().string());
}

NodeSettings readNodeSettings(const ros::NodeHandle& private_nh) {
  NodeSettings settings;
  settings.source = "parameters of " + private_nh.getNamespace();
  // The last two are diagnostic_updater's and dynamic_reconfigure's.
  settings.config =
      readConfiguration(private_nh, {"output_dir", "autosave_period", MapStore::kMapFile, MapStore::kResume,
                                     "initial_state", kDiagnosticPeriod, "tuning"});
  requireDiagnosticPeriod(private_nh);
  applyStored(private_nh, settings.config);
  if (private_nh.hasParam("output_dir") && !private_nh.getParam("output_dir", settings.output_dir)) {
    throw ConfigError(settings.source + ": output_dir must be a string: a folder, or empty to save nothing");
  }
  std::string initial_state;
  if (private_nh.hasParam("initial_state") && !private_nh.getParam("initial_state", initial_state))
    throw ConfigError(settings.source + ": initial_state must be a string: a file, or empty");
  if (!initial_state.empty()) settings.initial_state = readInitialState(absolutePath(initial_state));
  readPeriod(private_nh, "autosave_period", "0 (never)", settings.autosave_period_s);
  settings.output_dir = absolutePath(settings.output_dir);
  settings.maps = MapStore::readSettings(private_nh, settings.source,
                                         {settings.output_dir, {}, false, settings.config.ros.map_frame});
  settings.maps.map_file = absolutePath(settings.maps.map_file);
  if (!settings.output_dir.empty()) RunWriter::requireDirectory(settings.output_dir);
  return settings;
}

} // namespace vi_ekf_slam

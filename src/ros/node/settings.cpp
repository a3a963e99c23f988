#include "vi_ekf_slam/ros/node/settings.hpp"

#include <cstdlib>
#include <filesystem>
#include <iomanip>
#include <limits>
#include <set>
#include <sstream>

#include "vi_ekf_slam/core/run/calibration_files.hpp"
#include "vi_ekf_slam/core/run/run_writer.hpp"
#include "vi_ekf_slam/ros/node/tuning.hpp"

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

/// In seconds; `least`: the value 0 and what it stands for.
void readPeriod(const ros::NodeHandle& private_nh, const std::string& name, const std::string& least,
                double& seconds) {
  const std::string allowed = "a number of seconds from " + least + " to 1e6";
  readParameter(private_nh, name, allowed, seconds);
  if (!(seconds >= 0.0 && seconds <= 1e6)) failParameter(private_nh, name, allowed);
}

} // namespace

void failParameter(const ros::NodeHandle& private_nh, const std::string& name, const std::string& allowed) {
  throw ConfigError("parameters of " + private_nh.getNamespace() + ": " + name + " must be " + allowed);
}

void requireDiagnosticPeriod(const ros::NodeHandle& private_nh) {
  double seconds = 0.0;
  readPeriod(private_nh, kDiagnosticPeriod, "0", seconds);
}

YAML::Node toYaml(const XmlRpc::XmlRpcValue& const_value) {
  using XmlRpc::XmlRpcValue;
  XmlRpcValue value = const_value; // its accessors are not const
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return YAML::Node(static_cast<bool&>(value));
    case XmlRpcValue::TypeInt:
      return YAML::Node(static_cast<int&>(value));
    case XmlRpcValue::TypeDouble: { // yaml-cpp 0.6 would write a digit too few
      std::ostringstream text;
      text << std::setprecision(std::numeric_limits<double>::max_digits10) << static_cast<double&>(value);
      return YAML::Node(text.str());
    }
    case XmlRpcValue::TypeString:
      return YAML::Node(static_cast<std::string&>(value));
    case XmlRpcValue::TypeArray: {
      YAML::Node list(YAML::NodeType::Sequence);
      for (int i = 0; i < value.size(); ++i) list.push_back(toYaml(value[i]));
      return list;
    }
    case XmlRpcValue::TypeStruct: {
      YAML::Node map(YAML::NodeType::Map);
      for (const auto& [name, member] : value) map[name] = toYaml(member);
      return map;
    }
    default:
      return {};
  }
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
  settings.config = readConfiguration(private_nh, {"output_dir", "autosave_period", "map_file", "resume",
                                                   "initial_state", kDiagnosticPeriod, "tuning"});
  requireDiagnosticPeriod(private_nh);
  applyStored(private_nh, settings.config);
  MapStore::Settings& maps = settings.maps;
  std::string initial_state;
  readParameter(private_nh, "output_dir", "a string: a folder, or empty to save nothing", maps.output_dir);
  readParameter(private_nh, "initial_state", "a string: a file, or empty", initial_state);
  if (!initial_state.empty()) settings.initial_state = readInitialState(absolutePath(initial_state));
  readPeriod(private_nh, "autosave_period", "0 (never)", settings.autosave_period_s);
  readParameter(private_nh, "map_file", "a string: a map.bag to relocalise in, or empty", maps.map_file);
  readParameter(private_nh, "resume", "true or false", maps.resume);
  if (maps.resume && maps.output_dir.empty())
    throw ConfigError(settings.source +
                      ": resume is true, which needs output_dir: the folder to resume from");
  maps.map_frame = settings.config.ros.map_frame;
  maps.map_file = absolutePath(maps.map_file);
  maps.output_dir = absolutePath(maps.output_dir);
  if (!maps.output_dir.empty()) RunWriter::requireDirectory(maps.output_dir);
  return settings;
}

} // namespace vi_ekf_slam

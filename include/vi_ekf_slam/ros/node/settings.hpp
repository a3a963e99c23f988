#pragma once

#include <XmlRpcValue.h>
#include <ros/ros.h>
#include <yaml-cpp/yaml.h>

#include <optional>
#include <set>
#include <string>

#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/ros/node/map_store.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// The parameters that a node starts with.
struct NodeSettings {
  FullConfig config;                         ///< with what ~tuning holds in the place of its own
  std::string source;                        ///< where the parameters are, for messages
  double autosave_period_s = 60.0;           ///< s of wall time; 0: saved at the end only
  MapStore::Settings maps;                   ///< with ~output_dir, where everything is saved
  std::optional<InitialState> initial_state; ///< of ~initial_state
};

/// A parameter tree as YAML of the same values: numbers keep all digits, and a string that spells a number,
/// such as the 5e9 that roslaunch's YAML 1.1 takes for text, reads as that number.
YAML::Node toYaml(const XmlRpc::XmlRpcValue& value);

/// The configuration among the parameters below `private_nh`; files that it names are beside ~config_file,
/// where that is set. What is neither it nor one of the `known` names is warned of. Throws ConfigError.
FullConfig readConfiguration(const ros::NodeHandle& private_nh, const std::set<std::string>& known);

/// Throws ConfigError, which says what the parameter `name` must be.
[[noreturn]] void failParameter(const ros::NodeHandle& private_nh, const std::string& name,
                                const std::string& allowed);
/// The parameter, where it is set. Throws ConfigError where it is of another type.
template <typename T>
void readParameter(const ros::NodeHandle& private_nh, const std::string& name, const std::string& allowed,
                   T& value) {
  if (private_nh.hasParam(name) && !private_nh.getParam(name, value))
    failParameter(private_nh, name, allowed);
}

/// diagnostic_updater's parameter, which takes what it gets. Throws ConfigError where that is no period.
constexpr char kDiagnosticPeriod[] = "diagnostic_period";
void requireDiagnosticPeriod(const ros::NodeHandle& private_nh);

/// Throws ConfigError, or std::runtime_error when output_dir cannot be made.
NodeSettings readNodeSettings(const ros::NodeHandle& private_nh);

/// Absolute, with a leading ~ replaced by the home directory.
std::string absolutePath(const std::string& path);

} // namespace vi_ekf_slam

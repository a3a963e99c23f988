#pragma once

#include <ros/ros.h>

#include <optional>
#include <set>
#include <string>

#include "vi_ekf_slam/core/motion/initial_state.hpp"
#include "vi_ekf_slam/ros/node/map_store.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// The parameters that a node starts with.
struct NodeSettings {
  FullConfig config;               ///< with what ~tuning holds in the place of its own
  std::string source;              ///< where the parameters are, for messages
  std::string output_dir;          ///< absolute; empty: nothing is saved
  double autosave_period_s = 60.0; ///< s of wall time; 0: saved at the end only
  MapStore::Settings maps;
  std::optional<InitialState> initial_state; ///< of ~initial_state
};

/// The configuration among the parameters below `private_nh`; files that it names are beside ~config_file,
/// where that is set. What is neither it nor one of the `known` names is warned of. Throws ConfigError.
FullConfig readConfiguration(const ros::NodeHandle& private_nh, const std::set<std::string>& known);

/// diagnostic_updater's parameter, which takes what it gets. Throws ConfigError where that is no period.
constexpr char kDiagnosticPeriod[] = "diagnostic_period";
void requireDiagnosticPeriod(const ros::NodeHandle& private_nh);

/// Throws ConfigError, or std::runtime_error when output_dir cannot be made.
NodeSettings readNodeSettings(const ros::NodeHandle& private_nh);

/// Absolute, with a leading ~ replaced by the home directory.
std::string absolutePath(const std::string& path);

} // namespace vi_ekf_slam

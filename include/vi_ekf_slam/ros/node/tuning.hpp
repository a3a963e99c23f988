#pragma once

#include <dynamic_reconfigure/server.h>
#include <ros/ros.h>

#include <boost/thread/recursive_mutex.hpp>
#include <functional>
#include <memory>

#include "vi_ekf_slam/TuningConfig.h"
#include "vi_ekf_slam/core/slam/invariant_config.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// What may be changed while the node runs, by dynamic_reconfigure at `~tuning`: publishing rates and gates.
class Tuning {
 public:
  /// `private_nh`'s queue serves the changes. `apply` is called in its thread with each change, not with the
  /// values of `config` at the start; false: the node is ending, and nothing changes.
  Tuning(const ros::NodeHandle& private_nh, const FullConfig& config,
         std::function<bool(const TuningConfig&)> apply);

 private:
  void change(TuningConfig& wanted);

  TuningConfig current_;
  std::function<bool(const TuningConfig&)> apply_;
  boost::recursive_mutex mutex_; ///< the server's: with one of its own it warns of updateConfig
  dynamic_reconfigure::Server<TuningConfig> server_;
};

/// What ~tuning holds on the parameter server, as dynamic_reconfigure's servers start with, takes the place
/// of the configuration's. Throws ConfigError for what is not a number.
void applyStored(const ros::NodeHandle& private_nh, FullConfig& config);

/// The gates among the values.
Gates gatesOf(const TuningConfig& tuning);

} // namespace vi_ekf_slam

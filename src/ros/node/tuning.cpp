#include "vi_ekf_slam/ros/node/tuning.hpp"

#include <array>
#include <cmath>
#include <utility>

namespace vi_ekf_slam {
namespace {

std::array<double, 5> numbersOf(const TuningConfig& t) {
  return {t.path_period_s, t.landmark_period_s, t.max_bandwidth_bytes_s, t.gate, t.frame_gate};
}

TuningConfig tuningOf(const FullConfig& config) {
  TuningConfig tuning;
  tuning.path_period_s = config.ros.path_period_s;
  tuning.landmark_period_s = config.ros.landmark_period_s;
  tuning.max_bandwidth_bytes_s = config.ros.max_bandwidth_bytes_s;
  const Gates gates = config.core.invariant.gates();
  tuning.gate = gates.gate;
  tuning.frame_gate = gates.frame_gate;
  return tuning;
}

} // namespace

Gates gatesOf(const TuningConfig& tuning) { return {tuning.gate, tuning.frame_gate}; }

void applyStored(const ros::NodeHandle& private_nh, FullConfig& config) {
  const ros::NodeHandle nh(private_nh, "tuning");
  const TuningConfig configured = tuningOf(config);
  TuningConfig stored = configured;
  stored.__fromServer__(nh); // passes over what is of another type
  for (const auto& key : TuningConfig::__getParamDescriptions__()) {
    double number = 0.0;
    if (nh.hasParam(key->name) && !(nh.getParam(key->name, number) && std::isfinite(number)))
      throw ConfigError(nh.resolveName(key->name) + " must be a finite number");
  }
  stored.__clamp__();
  if (numbersOf(stored) == numbersOf(configured)) return;
  ROS_INFO_STREAM("rates and gates are those stored in " << nh.getNamespace() << ", not the configuration's");
  config.ros.path_period_s = stored.path_period_s;
  config.ros.landmark_period_s = stored.landmark_period_s;
  config.ros.max_bandwidth_bytes_s = stored.max_bandwidth_bytes_s;
  config.core.invariant.setGates(gatesOf(stored));
}

Tuning::Tuning(const ros::NodeHandle& private_nh, const FullConfig& config,
               std::function<bool(const TuningConfig&)> apply)
    : current_(tuningOf(config)),
      apply_(std::move(apply)),
      server_(mutex_, ros::NodeHandle(private_nh, "tuning")) {
  server_.updateConfig(current_);
  server_.setCallback([this](TuningConfig& wanted, std::uint32_t /*level*/) { change(wanted); });
}

/// `wanted` is within its limits, unless it is not a number; what it is afterwards is what the clients see.
void Tuning::change(TuningConfig& wanted) {
  const auto numbers = numbersOf(wanted);
  if (numbers == numbersOf(current_)) return;
  for (const double number : numbers) {
    if (std::isfinite(number)) continue;
    ROS_WARN("tuning: a value is not a number: nothing is changed");
    wanted = current_;
    return;
  }
  if (apply_(wanted)) {
    current_ = wanted;
    ROS_INFO("tuning: changed");
  } else {
    wanted = current_;
  }
}

} // namespace vi_ekf_slam

#pragma once

#include <XmlRpcValue.h>
#include <yaml-cpp/yaml.h>

namespace vi_ekf_slam {

/// A parameter tree as YAML of the same values: numbers keep all digits, and a string that spells a number,
/// such as the 5e9 that roslaunch's YAML 1.1 takes for text, reads as that number.
YAML::Node toYaml(const XmlRpc::XmlRpcValue& value);

} // namespace vi_ekf_slam

#pragma once

#include <XmlRpcValue.h>

#include <set>
#include <string>

namespace vi_ekf_slam {

/// A parameter tree as YAML text (flow style) that parses to the same values: numbers keep all digits, and a
/// string that spells a number, such as the 5e9 that roslaunch's YAML 1.1 takes for one, becomes that number
/// again. Top-level members named in `skip` are left out.
std::string toYaml(const XmlRpc::XmlRpcValue& value, const std::set<std::string>& skip = {});

} // namespace vi_ekf_slam

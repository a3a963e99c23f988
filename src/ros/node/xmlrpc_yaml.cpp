#include "vi_ekf_slam/ros/node/xmlrpc_yaml.hpp"

#include <iomanip>
#include <limits>
#include <sstream>

namespace vi_ekf_slam {

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

} // namespace vi_ekf_slam

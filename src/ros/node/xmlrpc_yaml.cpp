#include "vi_ekf_slam/ros/node/xmlrpc_yaml.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace vi_ekf_slam {
namespace {

using XmlRpc::XmlRpcValue;

std::string doubleText(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
  char text[40];
  std::snprintf(text, sizeof(text), "%.17g", value);
  const std::string digits = text;
  return digits.find_first_of(".e") == std::string::npos ? digits + ".0" : digits;
}

/// Whether the whole text is a decimal number: 5e9, but neither 0x10 nor nan nor an empty string.
bool spellsNumber(const std::string& text) {
  if (text.empty() || text.find_first_not_of("+-.0123456789eE") != std::string::npos) return false;
  char* end = nullptr;
  std::strtod(text.c_str(), &end);
  return *end == '\0';
}

std::string stringText(const std::string& text) {
  if (spellsNumber(text)) return text;
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (c == '\n') {
      out += "\\n";
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string structText(XmlRpcValue& value, const std::set<std::string>& skip) {
  std::string out = "{";
  for (auto& member : value) {
    if (skip.count(member.first) != 0) continue;
    out += (out.size() > 1 ? ", " : "") + ('"' + member.first + "\": ") + toYaml(member.second);
  }
  return out + "}";
}

std::string arrayText(XmlRpcValue& value) {
  std::string out = "[";
  for (int i = 0; i < value.size(); ++i) out += (i > 0 ? ", " : "") + toYaml(value[i]);
  return out + "]";
}

} // namespace

std::string toYaml(const XmlRpcValue& const_value, const std::set<std::string>& skip) {
  XmlRpcValue value = const_value; // its accessors are not const
  switch (value.getType()) {
    case XmlRpcValue::TypeBoolean:
      return static_cast<bool&>(value) ? "true" : "false";
    case XmlRpcValue::TypeInt:
      return std::to_string(static_cast<int&>(value));
    case XmlRpcValue::TypeDouble:
      return doubleText(static_cast<double&>(value));
    case XmlRpcValue::TypeString:
      return stringText(static_cast<std::string&>(value));
    case XmlRpcValue::TypeArray:
      return arrayText(value);
    case XmlRpcValue::TypeStruct:
      return structText(value, skip);
    default:
      return "null";
  }
}

} // namespace vi_ekf_slam

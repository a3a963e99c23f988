#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "vi_ekf_slam/core/run/parse_config.hpp"
#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam::test {

/// what() of the ConfigError that `f` throws; empty when it throws none.
template <typename F>
std::string errorOf(const F& f) {
  try {
    f();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

inline Config configOf(const std::string& yaml, const std::string& source,
                       const std::vector<std::string>& other_sections = {}) {
  return parseConfig(parseYaml(yaml, source), source, other_sections);
}

inline std::string errorIn(const std::string& yaml) {
  return errorOf([&] { configOf(yaml, "robot.yaml"); });
}

inline void expectAll(const std::string& message, const std::vector<std::string>& parts) {
  for (const auto& part : parts) {
    EXPECT_NE(message.find(part), std::string::npos) << "'" << part << "' is missing in: " << message;
  }
}

} // namespace vi_ekf_slam::test

#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/run/config.hpp"

namespace vi_ekf_slam {

/// Far above any configuration; what claims to be one and is larger is not read.
constexpr std::size_t kMaxYamlBytes = 1 << 20;

/// The text of a file of at most kMaxYamlBytes. Throws ConfigError.
std::string readYamlFile(const std::string& path);

/// What a number may be; `allowed` says so in an error message.
struct Range {
  double low, high;
  bool low_open, high_open;

  bool contains(double x) const;
  std::string text() const;

  static Range positive() { return {0.0, std::numeric_limits<double>::max(), true, false}; }
  static Range notNegative() { return {0.0, std::numeric_limits<double>::max(), false, false}; }
  static Range closed(double low, double high) { return {low, high, false, false}; }
  static Range halfOpen(double low, double high) { return {low, high, true, false}; }
};

/// Reads one mapping of a YAML document key by key. A key that is absent keeps the caller's default. Every
/// error is a ConfigError that names source, full key, value and what is allowed. finish() names the keys
/// nobody asked for.
class YamlSection {
 public:
  /// The document's root; an empty document is an empty mapping.
  static YamlSection root(const std::string& yaml, const std::string& source);

  YamlSection section(const std::string& key);
  void read(const std::string& key, const Range& range, double& value);
  void read(const std::string& key, const Range& range, std::size_t& value);
  void read(const std::string& key, bool& value);
  void read(const std::string& key, std::string& value);
  /// `size` numbers, or one that stands for all of them.
  void read(const std::string& key, const Range& range, Eigen::Ref<Eigen::VectorXd> value);
  template <typename Enum>
  void readChoice(const std::string& key, const std::vector<std::pair<std::string, Enum>>& choices,
                  Enum& value) {
    std::vector<std::string> names;
    for (const auto& choice : choices) names.push_back(choice.first);
    const std::size_t index = choiceIndex(key, names);
    if (index < choices.size()) value = choices[index].second;
  }
  /// Takes `key` as known without reading it.
  void allow(const std::string& key) { known_.insert(key); }
  void finish() const;

  /// A number is named as the document gives it, anything else as `value`.
  [[noreturn]] void fail(const std::string& key, const std::string& value, const std::string& allowed) const;

 private:
  YamlSection(YAML::Node node, std::string path, std::string source);

  YAML::Node find(const std::string& key);
  /// Position of the value in `names`, or names.size() when the key is absent.
  std::size_t choiceIndex(const std::string& key, const std::vector<std::string>& names);
  double number(const std::string& key, const YAML::Node& node, const Range& range) const;

  YAML::Node node_;
  std::string path_;
  std::string source_;
  std::set<std::string> known_;
};

} // namespace vi_ekf_slam

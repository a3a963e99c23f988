#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/slam/config.hpp"

namespace vi_ekf_slam {

/// The text of a file of at most 1 MiB, far above any configuration. Throws ConfigError.
std::string readYamlFile(const std::string& path);
/// The one document of a text. Throws ConfigError where it is none, or nests so deeply that yaml-cpp would
/// overflow the stack.
YAML::Node parseYaml(const std::string& yaml, const std::string& source);

/// What a number may be; `text` says so in an error message.
struct Range {
  double low, high;
  bool low_open;

  bool contains(double x) const { return (low_open ? x > low : x >= low) && x <= high; }
  std::string text() const;

  static Range positive() { return halfOpen(0.0, std::numeric_limits<double>::max()); }
  static Range notNegative() { return closed(0.0, std::numeric_limits<double>::max()); }
  static Range closed(double low, double high) { return {low, high, false}; }
  static Range halfOpen(double low, double high) { return {low, high, true}; }
};

/// Reads one mapping of a YAML document key by key. An absent key keeps the caller's default. Every error is
/// a ConfigError that names source, full key, value and what is allowed; finish() names keys nobody asked
/// for.
class YamlSection {
 public:
  /// The document's root; an empty document is an empty mapping.
  static YamlSection root(const YAML::Node& document, const std::string& source) {
    return {document, "", source};
  }
  static YamlSection root(const std::string& yaml, const std::string& source) {
    return root(parseYaml(yaml, source), source);
  }

  /// Of a key, for messages: source, sections and key.
  std::string nameOf(const std::string& key) const { return source_ + ": " + path_ + key; }
  bool has(const std::string& key) { return static_cast<bool>(find(key)); }
  /// s since the epoch, exact to the nanosecond; required.
  Stamp stamp(const std::string& key);
  YamlSection section(const std::string& key) { return {find(key), path_ + key + ".", source_}; }
  void read(const std::string& key, const Range& range, double& value);
  void read(const std::string& key, const Range& range, std::size_t& value);
  void read(const std::string& key, bool& value);
  void read(const std::string& key, std::string& value);
  /// `size` numbers, or one that stands for all of them.
  void read(const std::string& key, const Range& range, Eigen::Ref<Eigen::VectorXd> value);
  // The same of a key that must be there.
  double required(const std::string& key, const Range& range);
  Eigen::VectorXd required(const std::string& key, const Range& range, Eigen::Index size);
  template <typename Enum>
  void readChoice(const std::string& key, const std::vector<std::pair<std::string, Enum>>& choices,
                  Enum& value) {
    const YAML::Node node = find(key);
    if (!node) return;
    std::string names;
    for (const auto& [name, choice] : choices) {
      if (node.IsScalar() && node.Scalar() == name) return static_cast<void>(value = choice);
      names += (names.empty() ? "" : ", ") + name;
    }
    fail(key, describe(node), "one of " + names);
  }
  /// Takes `key` as known without reading it.
  void allow(const std::string& key) { known_.insert(key); }
  void finish() const;

  /// A number is named as the document gives it, anything else as `value`.
  [[noreturn]] void fail(const std::string& key, const std::string& value, const std::string& allowed) const;

 private:
  YamlSection(const YAML::Node& node, std::string path, std::string source);

  static std::string describe(const YAML::Node& node);
  YAML::Node find(const std::string& key);
  double number(const std::string& key, const YAML::Node& node, const Range& range) const;

  const YAML::Node node_; ///< a mapping; constant, so that to look for a key does not insert it
  std::string path_;
  std::string source_;
  std::set<std::string> known_;
};

} // namespace vi_ekf_slam

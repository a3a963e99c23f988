#include "vi_ekf_slam/core/run/yaml_section.hpp"

#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <regex>
#include <sstream>

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kMaxYamlBytes = 1 << 20;

// yaml-cpp before 0.7 descends into nested nodes without a bound and overflows the stack. Each level takes a
// bracket or a character of a line's beginning (indentation, "- ", "? "), so bounding both bounds it.
constexpr std::size_t kMaxNesting = 1000;

bool mayNestDeeply(const std::string& yaml) {
  std::size_t brackets = 0, leading = 0, longest = 0;
  bool at_beginning = true;
  for (const char c : yaml) {
    if (c == '[' || c == '{') ++brackets;
    if (c == '\n') {
      at_beginning = true;
      leading = 0;
    } else if (at_beginning) {
      at_beginning = c == ' ' || c == '\t' || c == '-' || c == '?' || c == ':';
      longest = std::max(longest, ++leading);
    }
  }
  return brackets > kMaxNesting || longest > kMaxNesting;
}

/// Counts the documents of a stream; YAML::Load reads the first and keeps silent about the others, and
/// YAML::LoadAll stops at the first empty one.
class DocumentCounter : public YAML::EventHandler {
  using Mark = YAML::Mark;
  using Anchor = YAML::anchor_t;
  using Style = YAML::EmitterStyle::value;

 public:
  int documents = 0;
  int line = 0; ///< of the newest document's first content, from 1

  void OnDocumentStart(const Mark& mark) override {
    ++documents;
    line = mark.line + 1;
  }
  void OnDocumentEnd() override {}
  void OnNull(const Mark&, Anchor) override {}
  void OnAlias(const Mark&, Anchor) override {}
  void OnScalar(const Mark&, const std::string&, Anchor, const std::string&) override {}
  void OnSequenceStart(const Mark&, const std::string&, Anchor, Style) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const Mark&, const std::string&, Anchor, Style) override {}
  void OnMapEnd() override {}
};

void expectOneDocument(const std::string& yaml, const std::string& source) {
  std::istringstream stream(yaml);
  YAML::Parser parser(stream);
  DocumentCounter counter;
  while (counter.documents < 2 && parser.HandleNextDocument(counter)) {
  }
  if (counter.documents > 1) {
    throw ConfigError(source + ": a second document begins after '---' at line " +
                      std::to_string(counter.line) + "; one is allowed");
  }
}

} // namespace

std::string readYamlFile(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw ConfigError(path + ": cannot be opened; it must be a readable YAML file");
  std::string text(kMaxYamlBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  // A directory opens, it is the reading that fails.
  if (file.bad()) throw ConfigError(path + ": cannot be read; it must be a YAML file, not a directory");
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kMaxYamlBytes) {
    throw ConfigError(path + ": is larger than " + std::to_string(kMaxYamlBytes) +
                      " bytes, which is the most that is allowed");
  }
  return text;
}

YAML::Node parseYaml(const std::string& yaml, const std::string& source) {
  if (mayNestDeeply(yaml)) {
    throw ConfigError(source + ": not readable as YAML: an indentation of more than " +
                      std::to_string(kMaxNesting) +
                      " characters or more than as many '[' and '{' are not allowed");
  }
  try {
    expectOneDocument(yaml, source);
    return YAML::Load(yaml);
  } catch (const YAML::Exception& error) {
    throw ConfigError(source + ": not readable as YAML: " + error.what());
  }
}

std::string Range::text() const {
  std::ostringstream text;
  text << "a finite number " << (low_open ? "> " : ">= ") << low;
  if (high < std::numeric_limits<double>::max()) text << " and <= " << high;
  return text.str();
}

YamlSection::YamlSection(const YAML::Node& node, std::string path, std::string source)
    : node_(node && !node.IsNull() ? node : YAML::Node(YAML::NodeType::Map)),
      path_(std::move(path)),
      source_(std::move(source)) {
  if (!node_.IsMap()) {
    const std::string name = path_.empty() ? "the document" : path_.substr(0, path_.size() - 1);
    throw ConfigError(source_ + ": " + name + ": '" + describe(node_) +
                      "' is not allowed; it must be a mapping of keys to values");
  }
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar()) throw ConfigError(source_ + ": " + path_ + ": a key is not a plain name");
    if (!seen.insert(entry.first.Scalar()).second)
      throw ConfigError(source_ + ": " + path_ + entry.first.Scalar() + ": given twice; once is allowed");
  }
}

std::string YamlSection::describe(const YAML::Node& node) {
  std::ostringstream text;
  text << node;
  const std::string value = text.str();
  return value.size() > 80 ? value.substr(0, 77) + "..." : value;
}

YAML::Node YamlSection::find(const std::string& key) {
  known_.insert(key);
  return node_[key];
}

void YamlSection::fail(const std::string& key, const std::string& value, const std::string& allowed) const {
  const YAML::Node given = node_[key];
  double x = 0.0;
  const bool is_number = given && YAML::convert<double>::decode(given, x);
  throw ConfigError(source_ + ": " + path_ + key + ": '" + (is_number ? given.Scalar() : value) +
                    "' is not allowed; it must be " + allowed);
}

double YamlSection::number(const std::string& key, const YAML::Node& node, const Range& range) const {
  double x = 0.0;
  if (!YAML::convert<double>::decode(node, x) || !range.contains(x)) fail(key, describe(node), range.text());
  return x;
}

void YamlSection::read(const std::string& key, const Range& range, double& value) {
  if (const YAML::Node node = find(key)) value = number(key, node, range);
}

void YamlSection::read(const std::string& key, const Range& range, std::size_t& value) {
  auto x = static_cast<double>(value);
  read(key, range, x);
  if (x != std::floor(x) || x < 0.0 || x > 9007199254740992.0)
    fail(key, describe(node_[key]), "a whole number");
  value = static_cast<std::size_t>(x);
}

Stamp YamlSection::stamp(const std::string& key) {
  static const std::regex kSeconds(R"((\d{1,10})(?:\.(\d{1,9}))?)");
  const YAML::Node node = find(key);
  std::smatch parts;
  const std::string text = node && node.IsScalar() ? node.Scalar() : std::string();
  if (!std::regex_match(text, parts, kSeconds))
    fail(key, node ? describe(node) : "missing",
         "seconds since the epoch, with at most 9 digits behind the point");
  std::string nanoseconds = parts[2].str();
  nanoseconds.resize(9, '0');
  return std::stoll(parts[1].str()) * 1000000000 + std::stoll(nanoseconds);
}

void YamlSection::read(const std::string& key, bool& value) {
  const YAML::Node node = find(key);
  if (node && !YAML::convert<bool>::decode(node, value)) fail(key, describe(node), "true or false");
}

void YamlSection::read(const std::string& key, std::string& value) {
  const YAML::Node node = find(key);
  if (node && !YAML::convert<std::string>::decode(node, value)) fail(key, describe(node), "a text");
}

void YamlSection::read(const std::string& key, const Range& range, Eigen::Ref<Eigen::VectorXd> value) {
  const YAML::Node node = find(key);
  if (!node) return;
  const Eigen::Index size = value.size();
  if (!node.IsScalar() && !(node.IsSequence() && static_cast<Eigen::Index>(node.size()) == size))
    fail(key, describe(node), "one number or a list of " + std::to_string(size));
  for (Eigen::Index i = 0; i < size; ++i)
    value[i] = node.IsScalar() ? number(key, node, range)
                               : number(key + "[" + std::to_string(i) + "]", node[i], range);
}

double YamlSection::required(const std::string& key, const Range& range) {
  double value = std::numeric_limits<double>::quiet_NaN();
  read(key, range, value);
  if (std::isnan(value)) fail(key, "missing", "a number");
  return value;
}

Eigen::VectorXd YamlSection::required(const std::string& key, const Range& range, Eigen::Index size) {
  Eigen::VectorXd value = Eigen::VectorXd::Constant(size, std::numeric_limits<double>::quiet_NaN());
  read(key, range, value);
  if (std::isnan(value[0])) fail(key, "missing", std::to_string(size) + " numbers");
  return value;
}

void YamlSection::finish() const {
  std::string known;
  for (const std::string& key : known_) known += (known.empty() ? "" : ", ") + key;
  for (const auto& entry : node_) {
    const std::string& key = entry.first.Scalar();
    if (known_.count(key) > 0) continue;
    const std::size_t at = key.find_first_of("./"); // as documentation and messages name a key of a section
    const std::string section = key.substr(0, at);
    throw ConfigError(nameOf(key) + ": unknown key; " +
                      (known_.count(section) == 0
                           ? "known are " + known
                           : "the key " + key.substr(at + 1) + " of the section " + section + " is written " +
                                 section + ": {" + key.substr(at + 1) + ": ...}"));
  }
}

} // namespace vi_ekf_slam

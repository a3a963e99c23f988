#pragma once

#include <string>
#include <vector>

#include "vi_ekf_slam/core/slam/config.hpp"

namespace YAML {
class Node;
}

namespace vi_ekf_slam {

/// Reads a YAML document and checks every value. Unknown keys are errors, except the top-level
/// `other_sections`, which belong to somebody else (the node's frames and topics). `source` is the file named
/// in messages; a file that the document names by a relative path is in `folder`.
Config parseConfig(const YAML::Node& document, const std::string& source,
                   const std::vector<std::string>& other_sections = {}, const std::string& folder = {});

} // namespace vi_ekf_slam

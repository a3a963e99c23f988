#pragma once

#include <string>

#include "vi_ekf_slam/ros/intake.hpp"

namespace vi_ekf_slam {

struct RunBagOptions {
  std::string bag;
  std::string config;        ///< empty: the built-in defaults
  std::string initial_state; ///< file; empty: none
  std::string output;
  std::string load_map;                                               ///< empty: none
  std::string save_calibration;                                       ///< file to be written
  bool save_map = false;                                              ///< DIR/map.bag too
  std::string save_features;                                          ///< bag to be made; empty: none
  std::string left_image = "left/image", right_image = "right/image"; ///< absolute names in the end
  bool check = false; ///< only look whether the files can be used
  InputTopics topics; ///< absolute names
  bool quiet = false;
  bool help = false;
};

/// Throws UsageError.
RunBagOptions parseRunBagOptions(int argc, const char* const* argv);

extern const char* const kRunBagHelp;

} // namespace vi_ekf_slam

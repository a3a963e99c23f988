#include "vi_ekf_slam/ros/node/node_arguments.hpp"

#include <ros/init.h>

#include <iostream>
#include <string>

namespace vi_ekf_slam {

std::optional<int> endsAtOnce(int argc, char** argv, const char* what) {
  ros::V_string arguments;
  ros::removeROSArgs(argc, argv, arguments);
  if (arguments.size() < 2) return std::nullopt;
  const std::string program = arguments[0].substr(arguments[0].rfind('/') + 1), &first = arguments[1];
  const bool is_asked = first == "--help" || first == "-h";
  if (!is_asked) std::cerr << program << ": unknown argument '" << first << "'\n";
  (is_asked ? std::cout : std::cerr) << "usage: " << program
                                     << " [_PARAMETER:=VALUE ...] [TOPIC:=OTHER ...]\n"
                                     << what;
  return is_asked ? 0 : 2;
}

} // namespace vi_ekf_slam

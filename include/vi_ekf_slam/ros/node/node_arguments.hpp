#pragma once

#include <optional>

namespace vi_ekf_slam {

/// The command line of a node, which takes what ROS takes (`_PARAMETER:=VALUE`, `TOPIC:=OTHER`) and `--help`,
/// before it waits for a master. The status with which it is to end instead of running: 0 where it has
/// explained itself (`what` it is, on stdout), 2 where it does not know an argument (on stderr).
std::optional<int> endsAtOnce(int argc, char** argv, const char* what);

} // namespace vi_ekf_slam

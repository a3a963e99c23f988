/// The node: topics and parameters are described in docs/front_end.md.
#include <ros/ros.h>

#include "vi_ekf_slam/core/run/memory.hpp"
#include "vi_ekf_slam/ros/front_end/front_end_node.hpp"
#include "vi_ekf_slam/ros/node/node_arguments.hpp"

namespace {

constexpr char kWhat[] =
    "\nThe stereo front end: a stereo pair's images in, features out. It waits for a master. slam.launch\n"
    "starts it with front_end:=true; topics and parameters are in docs/front_end.md.\n";

} // namespace

int main(int argc, char** argv) {
  if (const auto status = vi_ekf_slam::endsAtOnce(argc, argv, kWhat)) return *status;
  vi_ekf_slam::keepFreedMemory();
  ros::init(argc, argv, "front_end");
  const ros::NodeHandle nh; // outlives the node: with the last handle ROS ends, and says nothing more
  const ros::NodeHandle private_nh("~");
  try {
    const vi_ekf_slam::FrontEndNode node(nh, private_nh);
    ros::spin();
  } catch (const std::exception& e) {
    ROS_FATAL_STREAM(e.what());
    ros::shutdown();
    return 1;
  }
  return 0;
}

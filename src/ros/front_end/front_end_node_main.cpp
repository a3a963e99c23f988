/// The node: topics and parameters are described in docs/front_end.md.
#include <ros/ros.h>

#include "vi_ekf_slam/core/run/memory.hpp"
#include "vi_ekf_slam/ros/front_end/front_end_node.hpp"

int main(int argc, char** argv) {
  vi_ekf_slam::keepFreedMemory();
  ros::init(argc, argv, "front_end");
  try {
    const vi_ekf_slam::FrontEndNode node(ros::NodeHandle(), ros::NodeHandle("~"));
    ros::spin();
  } catch (const std::exception& e) {
    ROS_FATAL_STREAM(e.what());
    ros::shutdown();
    return 1;
  }
  return 0;
}

/// The node: parameters, topics and services are described in SlamNode and the launch file.
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <ros/xmlrpc_manager.h>

#include <csignal>
#include <stdexcept>

#include "vi_ekf_slam/core/run/memory.hpp"
#include "vi_ekf_slam/ros/node/node_arguments.hpp"
#include "vi_ekf_slam/ros/node/slam_node.hpp"
#include "vi_ekf_slam/ros/node/stop_request.hpp"

namespace {

using vi_ekf_slam::g_stop;
using vi_ekf_slam::requestStop;

constexpr char kWhat[] =
    "\nThe SLAM node: IMU, velocity and stereo features in; pose, path and map out. It waits for a master.\n"
    "slam.launch starts it with all that it needs (roslaunch vi_ekf_slam slam.launch --ros-args).\n"
    "Topics are in docs/own_rig.md, parameters in docs/configuration.md.\n";
constexpr double kSpinPeriod = 0.05; // s
constexpr double kDrainLimit = 2.0;  // s; the callbacks only hand messages on

/// `rosnode kill` and a second node of the same name.
void requestStopByMaster(XmlRpc::XmlRpcValue& /*parameters*/, XmlRpc::XmlRpcValue& result) {
  g_stop = true;
  result = ros::xmlrpc::responseInt(1, "", 0);
}

/// roscpp's own handlers drop the queued messages; ours let them be processed and saved first.
void installStopHandlers() {
  std::signal(SIGINT, requestStop);
  std::signal(SIGTERM, requestStop);
  // The terminal was closed, for which nohup has it run on.
  if (std::signal(SIGHUP, requestStop) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
  ros::XMLRPCManager::instance()->unbind("shutdown");
  ros::XMLRPCManager::instance()->bind("shutdown", requestStopByMaster);
}

void drain(ros::CallbackQueue& queue) {
  const ros::WallTime start = ros::WallTime::now();
  do {
    queue.callAvailable(ros::WallDuration(kSpinPeriod));
  } while (!queue.isEmpty() && (ros::WallTime::now() - start).toSec() < kDrainLimit);
}

} // namespace

int main(int argc, char** argv) {
  if (const auto status = vi_ekf_slam::endsAtOnce(argc, argv, kWhat)) return *status;
  vi_ekf_slam::keepFreedMemory();
  ros::init(argc, argv, "slam", ros::init_options::NoSigintHandler);
  const ros::NodeHandle nh;
  const ros::NodeHandle private_nh("~");
  installStopHandlers();
  try {
    vi_ekf_slam::SlamNode node(nh, private_nh);
    ros::CallbackQueue& queue = *ros::getGlobalCallbackQueue();
    while (!g_stop && ros::ok() && node.failure().empty()) {
      queue.callAvailable(ros::WallDuration(kSpinPeriod));
    }
    if (ros::ok()) drain(queue);
    node.finish();
    if (!node.failure().empty()) throw std::runtime_error(node.failure());
  } catch (const std::exception& e) {
    ROS_FATAL_STREAM(e.what());
    ros::shutdown();
    return 1;
  }
  ros::shutdown();
  return 0;
}

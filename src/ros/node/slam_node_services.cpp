// What SlamNode does when it is asked, in the services' thread.

#include "vi_ekf_slam/ros/node/slam_node.hpp"

namespace vi_ekf_slam {

void SlamNode::advertiseServices() {
  ros::NodeHandle nh(private_nh_);
  nh.setCallbackQueue(&service_queue_);
  services_ = {nh.advertiseService("reset", &SlamNode::serveReset, this),
               nh.advertiseService("save_trajectory", &SlamNode::serveSaveTrajectory, this),
               nh.advertiseService("save_map", &SlamNode::serveSaveMap, this),
               nh.advertiseService("load_map", &SlamNode::serveLoadMap, this)};
  tuning_ = std::make_unique<Tuning>(nh, settings_.config, [this](const TuningConfig& t) { return tune(t); });
  service_spinner_.start();
}

bool SlamNode::runInWorker(const std::function<void()>& task) {
  const auto packaged = std::make_shared<std::packaged_task<void()>>(task);
  std::future<void> done = packaged->get_future();
  if (!queue_.push([packaged] { (*packaged)(); }, {})) return false;
  try {
    done.get();
  } catch (const std::future_error&) {
    return false; // the node ends, and the task was thrown away
  }
  return true;
}

bool SlamNode::tune(const TuningConfig& tuning) {
  return runInWorker([&] {
    publishers_.setRates(tuning.path_period_s, tuning.landmark_period_s, tuning.max_bandwidth_bytes_s);
    system_.setGates(gatesOf(tuning));
  });
}

bool SlamNode::serveReset(std_srvs::Empty::Request& /*request*/, std_srvs::Empty::Response& /*response*/) {
  return runInWorker([this] { system_.reset("asked for by " + private_nh_.resolveName("reset")); });
}

/// The file is read before anything is given up for it.
bool SlamNode::serveLoadMap(std_srvs::Trigger::Request& /*request*/, std_srvs::Trigger::Response& response) {
  response.success = 0;
  try {
    const auto map = maps_.load();
    const bool done = runInWorker([&] { system_.loadMap(map, maps_.source()); });
    response.success = done ? 1 : 0;
    response.message = done ? "loaded " + maps_.source() + " with " + std::to_string(map->landmarks.size()) +
                                  " landmarks; not yet relocalised in it"
                            : "nothing loaded: the node is ending";
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

} // namespace vi_ekf_slam

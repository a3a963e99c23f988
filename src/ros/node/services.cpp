#include "vi_ekf_slam/ros/node/services.hpp"

#include <exception>
#include <utility>

namespace vi_ekf_slam {
namespace {

/// What is wrong with a file's name in a request; empty: nothing.
std::string fileProblem(const std::string& file) {
  if (file.empty() || file.front() == '/' || file == "~" || file.rfind("~/", 0) == 0) return {};
  return "file is '" + file + "', allowed: an absolute path, one from ~ on, or nothing";
}

template <typename Response>
bool respond(const Results::Answer& answer, Response& response) {
  response.success = answer.success;
  response.message = answer.message;
  return true;
}

} // namespace

Services::Services(const ros::NodeHandle& private_nh, const FullConfig& config, Actions actions,
                   Worker& worker, Results& results, const MapStore& maps)
    : nh_(private_nh), actions_(std::move(actions)), worker_(worker), results_(results), maps_(maps) {
  nh_.setCallbackQueue(&queue_);
  servers_ = {nh_.advertiseService("reset", &Services::reset, this),
              nh_.advertiseService("set_pose", &Services::setPose, this),
              nh_.advertiseService("set_state", &Services::setState, this),
              nh_.advertiseService("save_trajectory", &Services::saveTrajectory, this),
              nh_.advertiseService("save_map", &Services::saveMap, this),
              nh_.advertiseService("load_map", &Services::loadMap, this)};
  tuning_ = std::make_unique<Tuning>(
      nh_, config, [this](const TuningConfig& t) { return worker_.run([&] { actions_.tune(t); }); });
  spinner_.start();
}

void Services::stop() {
  for (ros::ServiceServer& server : servers_) server.shutdown();
  spinner_.stop();
  tuning_.reset();
}

bool Services::reset(std_srvs::Empty::Request& /*request*/, std_srvs::Empty::Response& /*response*/) {
  return worker_.run([this] { actions_.reset("asked for by " + nh_.resolveName("reset")); });
}

/// `action`, done in the worker, says why `what` is not set; empty: it is.
Results::Answer Services::set(const std::string& what, const std::function<std::string()>& action) {
  std::string problem;
  if (!worker_.run([&] { problem = action(); })) problem = what + " is not set: the node is ending";
  if (!problem.empty()) return {false, problem};
  return {true, what + " is set"};
}

bool Services::setPose(SetPose::Request& request, SetPose::Response& response) {
  return respond(set("the pose", [&] { return actions_.set_pose(request.pose); }), response);
}

bool Services::setState(SetState::Request& request, SetState::Response& response) {
  Results::Answer answer = set("the state", [&] { return actions_.set_state(request); });
  if (answer.success) answer.message += "; everything begins anew from there";
  return respond(answer, response);
}

bool Services::saveTrajectory(std_srvs::Trigger::Request& /*request*/,
                              std_srvs::Trigger::Response& response) {
  return respond(results_.saveTrajectory(), response);
}

bool Services::saveMap(SaveMap::Request& request, SaveMap::Response& response) {
  const std::string problem = fileProblem(request.file);
  if (!problem.empty()) return respond({false, problem}, response);
  return respond(results_.saveMap(absolutePath(request.file)), response);
}

/// The file is read before anything is given up for it.
bool Services::loadMap(LoadMap::Request& request, LoadMap::Response& response) {
  response.success = 0;
  response.message = fileProblem(request.file);
  if (!response.message.empty()) return true;
  try {
    const std::string file = request.file.empty() ? maps_.source() : absolutePath(request.file);
    const auto map = maps_.load(file);
    const bool done = worker_.run([&] { actions_.load_map(map, file); });
    response.success = done ? 1 : 0;
    response.message = done ? "loaded " + file + " with " + std::to_string(map->landmarks.size()) +
                                  " landmarks; not yet relocalised in it"
                            : "nothing loaded: the node is ending";
  } catch (const std::exception& e) {
    response.message = e.what();
  }
  return true;
}

} // namespace vi_ekf_slam

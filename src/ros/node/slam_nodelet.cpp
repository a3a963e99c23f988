#include <nodelet/NodeletUnload.h>
#include <nodelet/nodelet.h>

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>
#include <mutex>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>
#include <string>
#include <thread>

#include "vi_ekf_slam/ros/node/slam_node.hpp"
#include "vi_ekf_slam/ros/node/stop_request.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::chrono::milliseconds kWatchPeriod{50};
constexpr std::chrono::milliseconds kHandOver{200}; // what was received is in the manager's queue still

/// roscpp's own handler of SIGINT drops what was received, and nobody handles SIGTERM and SIGHUP: the process
/// would end with nothing saved. With these everything is saved first, and then the manager shuts down. They
/// stay for as long as there is a nodelet of ours.
class StopHandlers {
 public:
  void noteBegin() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (running_++ > 0) return;
    struct sigaction ours = {};
    ours.sa_handler = requestStop;
    for (std::size_t i = 0; i < kSignals.size(); ++i) {
      sigaction(kSignals[i], &ours, &before_[i]);
      const bool by_nohup = kSignals[i] == SIGHUP && before_[i].sa_handler == SIG_IGN;
      if (by_nohup) sigaction(kSignals[i], &before_[i], nullptr);
    }
  }

  void noteEnd() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (--running_ > 0) return;
    for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
    if (g_stop) ros::requestShutdown();
  }

 private:
  static constexpr std::array<int, 3> kSignals = {SIGHUP, SIGINT, SIGTERM};

  std::mutex mutex_;
  int running_ = 0;
  std::array<struct sigaction, kSignals.size()> before_{};
};

StopHandlers g_stop_handlers; // of the process, as signals are

/// Asks the manager to unload the nodelet, which breaks the bond with what loaded it; a process of this
/// nodelet alone (`nodelet standalone`) has no such service, and shuts down. In a thread of its own, which
/// may outlive the nodelet: the manager answers once the nodelet is gone.
void leaveManager(const std::string& name) {
  std::thread([name] {
    const std::string service = ros::this_node::getName() + "/unload_nodelet";
    nodelet::NodeletUnload unload;
    unload.request.name = name;
    if (ros::service::exists(service, false) && ros::service::call(service, unload) &&
        unload.response.success)
      return;
    ros::requestShutdown();
  }).detach();
}

} // namespace

/// SlamNode inside a nodelet manager; everything runs on the manager's single-threaded queue for this
/// nodelet.
class SlamNodelet : public nodelet::Nodelet {
 public:
  ~SlamNodelet() override {
    leaving_ = true;
    if (watch_.joinable()) watch_.join();
  }

 private:
  void onInit() override {
    try {
      node_ = std::make_unique<SlamNode>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const std::exception& e) {
      NODELET_FATAL_STREAM(e.what());
      throw; // the manager then reports that the nodelet cannot be loaded
    }
    g_stop_handlers.noteBegin();
    watch_ = std::thread(&SlamNodelet::watch, this);
  }

  /// Saves, and says so, while ROS still runs.
  void watch() {
    while (!leaving_) {
      std::this_thread::sleep_for(kWatchPeriod);
      const bool failed = !node_->failure().empty();
      if (!g_stop && !failed) continue;
      if (!failed) std::this_thread::sleep_for(kHandOver);
      node_->finish();
      if (failed) {
        NODELET_FATAL_STREAM(node_->failure() << "; the nodelet ends");
        leaveManager(getName());
      }
      break;
    }
    g_stop_handlers.noteEnd();
  }

  std::unique_ptr<SlamNode> node_;
  std::atomic<bool> leaving_{false};
  std::thread watch_;
};

} // namespace vi_ekf_slam

PLUGINLIB_EXPORT_CLASS(vi_ekf_slam::SlamNodelet, nodelet::Nodelet)

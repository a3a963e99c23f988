#pragma once

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_srvs/Empty.h>
#include <std_srvs/Trigger.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "vi_ekf_slam/LoadMap.h"
#include "vi_ekf_slam/SaveMap.h"
#include "vi_ekf_slam/SetPose.h"
#include "vi_ekf_slam/SetState.h"
#include "vi_ekf_slam/ros/node/results.hpp"
#include "vi_ekf_slam/ros/node/tuning.hpp"

namespace vi_ekf_slam {

/// What a node does when it is asked, in a thread of its own. What touches the estimate is handed to the
/// worker and waited for.
class Services {
 public:
  /// Called in the worker.
  struct Actions {
    std::function<void(const std::string& reason)> reset;
    std::function<void(std::shared_ptr<const SavedMap> map, const std::string& file)> load_map;
    /// Why nothing was done; empty: it was.
    std::function<std::string(const geometry_msgs::PoseWithCovarianceStamped& pose)> set_pose;
    std::function<std::string(const SetState::Request& state)> set_state;
    std::function<void(const TuningConfig& tuning)> tune;
  };

  /// What is referred to must outlive this.
  Services(const ros::NodeHandle& private_nh, const FullConfig& config, Actions actions, Worker& worker,
           Results& results, const MapStore& maps);
  ~Services() { stop(); }
  Services(const Services&) = delete;
  Services& operator=(const Services&) = delete;

  /// Answers no more. A second call does nothing.
  void stop();

 private:
  Results::Answer set(const std::string& what, const std::function<std::string()>& action);
  bool reset(std_srvs::Empty::Request& request, std_srvs::Empty::Response& response);
  bool setPose(SetPose::Request& request, SetPose::Response& response);
  bool setState(SetState::Request& request, SetState::Response& response);
  bool saveTrajectory(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool saveMap(SaveMap::Request& request, SaveMap::Response& response);
  bool loadMap(LoadMap::Request& request, LoadMap::Response& response);

  ros::NodeHandle nh_; ///< of the thread's queue
  Actions actions_;
  Worker& worker_;
  Results& results_;
  const MapStore& maps_;
  ros::CallbackQueue queue_;
  std::vector<ros::ServiceServer> servers_;
  std::unique_ptr<Tuning> tuning_;
  ros::AsyncSpinner spinner_{1, &queue_};
};

} // namespace vi_ekf_slam

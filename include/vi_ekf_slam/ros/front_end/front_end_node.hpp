#pragma once

#include <image_transport/image_transport.h>
#include <image_transport/subscriber.h>
#include <ros/ros.h>

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "vi_ekf_slam/ros/front_end/front_end_diagnostics.hpp"
#include "vi_ekf_slam/ros/front_end/image_intake.hpp"
#include "vi_ekf_slam/ros/node/subscriptions.hpp"
#include "vi_ekf_slam/ros/node/work_queue.hpp"

namespace vi_ekf_slam {

/// Connects the topics of images to ImageIntake and sends the features; the same for the node and the
/// nodelet.
///
/// Callbacks only put messages into a queue; one thread decodes, computes and publishes. While it is busy,
/// pairs wait; of those that are there when it is done, the newest is taken and the others are shed, unless
/// ros/max_latency_s is 0.
class FrontEndNode {
 public:
  /// Throws ConfigError: the node must not start then.
  FrontEndNode(ros::NodeHandle nh, ros::NodeHandle private_nh);
  ~FrontEndNode();
  FrontEndNode(const FrontEndNode&) = delete;
  FrontEndNode& operator=(const FrontEndNode&) = delete;

 private:
  void subscribe(const std::string& transport);
  void run();
  bool takeIn(double wait_s);
  void work();
  bool hasEnded() const;
  void draw(const StereoImages& images, const FrontEnd& front_end);
  void report();

  ros::NodeHandle nh_;
  FullConfig config_;
  ImageIntake intake_;
  image_transport::ImageTransport transport_;
  image_transport::Publisher drawings_;
  ros::Publisher features_;
  FrontEndDiagnostics diagnostics_;
  std::map<std::string, std::uint64_t> warned_;
  std::set<std::string> warned_of_; ///< flaws of pairs that were used
  WorkQueue::Clock::time_point last_input_ = WorkQueue::Clock::now();
  ros::Time time_of_last_input_;
  WorkQueue::Clock::time_point last_warning_ = WorkQueue::Clock::now();
  WorkQueue queue_{{0.0, 100000}};
  Subscriptions subscriptions_{nh_, queue_};
  std::vector<image_transport::Subscriber> images_;
  std::thread worker_;
};

} // namespace vi_ekf_slam

#pragma once

#include <ros/ros.h>
#include <tf2_msgs/TFMessage.h>

#include <boost/function.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/node/work_queue.hpp"

namespace vi_ekf_slam {

/// The inputs' names as they are remapped.
InputTopics resolvedTopics(const ros::NodeHandle& nh);

/// The topics that a node listens to. Their callbacks only put each message into the worker's queue; what is
/// to be done with it is done in the worker.
class Subscriptions {
 public:
  static constexpr std::uint32_t kQueueSize =
      10000; ///< messages a topic; deep, so that a busy machine loses nothing

  /// `queue` must outlive this.
  Subscriptions(ros::NodeHandle nh, WorkQueue& queue) : nh_(std::move(nh)), queue_(queue) {}

  /// `stream`: what a measurement counts for in the queue.
  template <typename Message>
  void listen(const std::string& topic, std::function<void(const Message&)> process,
              std::optional<Stream> stream = {}) {
    const auto callback = [process](const boost::shared_ptr<const Message>& message) { process(*message); };
    listenToPointers<Message>(topic, kQueueSize, callback, stream);
  }
  /// For messages that are kept.
  template <typename Message>
  void listenToPointers(const std::string& topic, std::uint32_t queue_size,
                        std::function<void(const boost::shared_ptr<const Message>&)> process,
                        std::optional<Stream> stream = {}) {
    using Pointer = boost::shared_ptr<const Message>;
    const boost::function<void(const Pointer&)> callback = [this, process, stream](const Pointer& message) {
      queue_.push([process, message] { process(message); }, stream);
    };
    subscribers_.push_back(nh_.subscribe<Message>(topic, queue_size, callback, ros::VoidConstPtr(),
                                                  ros::TransportHints().tcpNoDelay()));
  }
  /// To /tf_static and /tf. `of_this_process`: it, or another nodelet of its manager, has sent the message.
  void listenToTransforms(const std::function<void(const tf2_msgs::TFMessage& message, bool is_static,
                                                   bool of_this_process)>& process);

  /// Whether somebody publishes on a topic that is listened to; its name resolved.
  bool hasPublisher(const std::string& topic) const;

  /// No callback comes any more.
  void shutdown();

 private:
  ros::NodeHandle nh_;
  WorkQueue& queue_;
  std::vector<ros::Subscriber> subscribers_;
};

} // namespace vi_ekf_slam

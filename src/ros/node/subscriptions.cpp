#include "vi_ekf_slam/ros/node/subscriptions.hpp"

#include <algorithm>

namespace vi_ekf_slam {

void Subscriptions::listenToTransforms(
    const std::string& topic,
    const std::function<void(const tf2_msgs::TFMessage& message, bool of_this_process)>& process) {
  using Event = ros::MessageEvent<const tf2_msgs::TFMessage>;
  const boost::function<void(const Event&)> callback = [this, process](const Event& event) {
    const bool of_this_process = event.getPublisherName() == ros::this_node::getName();
    queue_.push(
        [process, of_this_process, message = event.getConstMessage()] { process(*message, of_this_process); },
        {});
  };
  ros::SubscribeOptions options;
  options.initByFullCallbackType<const Event&>(topic, kQueueSize, callback);
  options.transport_hints = ros::TransportHints().tcpNoDelay();
  subscribers_.push_back(nh_.subscribe(options));
}

bool Subscriptions::hasPublisher(const std::string& topic) const {
  return std::any_of(subscribers_.begin(), subscribers_.end(), [&topic](const ros::Subscriber& subscriber) {
    return subscriber.getTopic() == topic && subscriber.getNumPublishers() > 0;
  });
}

void Subscriptions::shutdown() {
  for (ros::Subscriber& subscriber : subscribers_) subscriber.shutdown();
}

} // namespace vi_ekf_slam

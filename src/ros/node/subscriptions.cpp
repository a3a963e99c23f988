#include "vi_ekf_slam/ros/node/subscriptions.hpp"

#include <algorithm>

namespace vi_ekf_slam {

InputTopics resolvedTopics(const ros::NodeHandle& nh) {
  InputTopics topics;
  for (std::string* name : {&topics.imu, &topics.velocity, &topics.wheel_odometry, &topics.twist_bias,
                            &topics.features, &topics.left_info, &topics.right_info}) {
    *name = nh.resolveName(*name);
  }
  return topics;
}

void Subscriptions::listenToTransforms(
    const std::function<void(const tf2_msgs::TFMessage& message, bool is_static, bool of_this_process)>&
        process) {
  using Event = ros::MessageEvent<const tf2_msgs::TFMessage>;
  for (const bool is_static : {true, false}) {
    const boost::function<void(const Event&)> callback = [this, process, is_static](const Event& event) {
      const bool of_this_process = event.getPublisherName() == ros::this_node::getName();
      queue_.push([process, is_static, of_this_process,
                   message = event.getConstMessage()] { process(*message, is_static, of_this_process); },
                  {});
    };
    ros::SubscribeOptions options;
    options.initByFullCallbackType<const Event&>(is_static ? "/tf_static" : "/tf", kQueueSize, callback);
    options.transport_hints = ros::TransportHints().tcpNoDelay();
    subscribers_.push_back(nh_.subscribe(options));
  }
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

#pragma once

#include <ros/ros.h>

#include <atomic>
#include <string>

namespace vi_ekf_slam {

/// Messages held for a listener; one that is slower wants the newest.
constexpr std::uint32_t kOutputQueue = 10;

/// A new listener is only noted in `listener_came`, which must outlive the publisher: its callback runs
/// beside the thread that owns what is sent.
template <typename Message>
ros::Publisher advertiseLatched(ros::NodeHandle& nh, const std::string& topic,
                                std::atomic<bool>& listener_came) {
  return nh.advertise<Message>(
      topic, kOutputQueue,
      [&listener_came](const ros::SingleSubscriberPublisher& /*listener*/) { listener_came = true; },
      ros::SubscriberStatusCallback(), ros::VoidConstPtr(), true);
}

} // namespace vi_ekf_slam

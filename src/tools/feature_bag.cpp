#include "feature_bag.hpp"

#include <boost/make_shared.hpp>

#include "vi_ekf_slam/ros/wire_check.hpp"

namespace vi_ekf_slam {

template <typename Message>
void FeatureBag::put(const std::string& topic, std::uint64_t time, const Message& message, bool is_latched) {
  boost::shared_ptr<ros::M_string> header;
  if (is_latched) {
    header = boost::make_shared<ros::M_string>();
    (*header)["topic"] = topic;
    (*header)["type"] = ros::message_traits::datatype<Message>();
    (*header)["md5sum"] = ros::message_traits::md5sum<Message>();
    (*header)["message_definition"] = ros::message_traits::definition<Message>();
    (*header)["latching"] = "1";
    (*header)["callerid"] = "/run_bag";
  }
  bag_.write(topic, ros::Time().fromNSec(time), message, header);
}

void FeatureBag::copy(const BagMessage& message) {
  const std::string& topic = message.connection.topic;
  const auto as = [&](auto type) {
    put(topic, message.time, wire::read<decltype(type)>(message),
        topic == "/tf_static" || topic == topics_.twist_bias);
  };
  if (topic == topics_.imu) as(sensor_msgs::Imu());
  if (topic == topics_.velocity || topic == topics_.twist_bias)
    as(geometry_msgs::TwistWithCovarianceStamped());
  if (topic == topics_.wheel_odometry) as(nav_msgs::Odometry());
  if (topic == topics_.left_info || topic == topics_.right_info) as(sensor_msgs::CameraInfo());
  if (topic == "/tf" || topic == "/tf_static") as(tf2_msgs::TFMessage());
}

void FeatureBag::write(const StereoFeatureArray& features, std::uint64_t time) {
  put(topics_.features, time, features, false);
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/ros/output/map_publisher.hpp"

#include <ros/serialization.h>

#include <algorithm>
#include <utility>

namespace vi_ekf_slam {

MapPublisher::MapPublisher(ros::NodeHandle& nh, const RosConfig& config, LandmarkSource landmarks,
                           PathSource path, std::atomic<bool>& listener_came)
    : frame_(config.map_frame),
      landmarks_(std::move(landmarks)),
      path_(std::move(path)),
      pacer_(config.landmark_period_s, config.max_bandwidth_bytes_s),
      markers_(advertiseLatched<visualization_msgs::MarkerArray>(nh, "landmarks", listener_came)),
      cloud_(advertiseLatched<sensor_msgs::PointCloud2>(nh, "landmark_cloud", listener_came)) {}

void MapPublisher::send(Stamp stamp) {
  const bool markers_wanted = markers_.getNumSubscribers() > 0;
  const bool cloud_wanted = cloud_.getNumSubscribers() > 0;
  if (!markers_wanted && !cloud_wanted) return;
  const auto landmarks = landmarks_();
  std::size_t bytes = 0; // of the larger topic
  if (markers_wanted) {
    auto markers = toMarkers(landmarks, stamp, frame_, markers_shown_);
    markers.markers.push_back(loopMarker(path_(), stamp, frame_));
    markers_shown_ = (landmarks.size() + kMaxPointsPerMarker - 1) / kMaxPointsPerMarker;
    bytes = ros::serialization::serializationLength(markers);
    markers_.publish(markers);
  }
  if (cloud_wanted) {
    const auto cloud = toCloud(landmarks, stamp, frame_);
    bytes = std::max<std::size_t>(bytes, ros::serialization::serializationLength(cloud));
    cloud_.publish(cloud);
  }
  pacer_.noteSent(stamp, bytes);
}

void MapPublisher::reset(std::optional<Stamp> stamp) {
  markers_shown_ = 0;
  pacer_.restart();
  markers_.publish(deleteAllMarkers(frame_));
  if (stamp) cloud_.publish(toCloud({}, *stamp, frame_));
}

} // namespace vi_ekf_slam

#include <nodelet/nodelet.h>

#include <memory>
#include <pluginlib/class_list_macros.hpp>

#include "vi_ekf_slam/ros/front_end/front_end_node.hpp"

namespace vi_ekf_slam {

/// FrontEndNode inside a nodelet manager: images of a camera's nodelet, and features for SlamNodelet, are not
/// copied.
class StereoFrontEndNodelet : public nodelet::Nodelet {
  void onInit() override {
    try {
      node_ = std::make_unique<FrontEndNode>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const std::exception& e) {
      NODELET_FATAL_STREAM(e.what());
      throw; // the manager then reports that the nodelet cannot be loaded
    }
  }

  std::unique_ptr<FrontEndNode> node_;
};

} // namespace vi_ekf_slam

PLUGINLIB_EXPORT_CLASS(vi_ekf_slam::StereoFrontEndNodelet, nodelet::Nodelet)

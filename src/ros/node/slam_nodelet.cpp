#include <nodelet/nodelet.h>

#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <stdexcept>

#include "vi_ekf_slam/ros/node/slam_node.hpp"

namespace vi_ekf_slam {

/// SlamNode inside a nodelet manager; everything runs on the manager's single-threaded queue for this
/// nodelet.
class SlamNodelet : public nodelet::Nodelet {
 private:
  void onInit() override {
    try {
      node_ = std::make_unique<SlamNode>(getNodeHandle(), getPrivateNodeHandle());
    } catch (const std::exception& e) {
      NODELET_FATAL_STREAM(e.what());
      throw; // the manager then reports that the nodelet cannot be loaded
    }
  }

  std::unique_ptr<SlamNode> node_;
};

} // namespace vi_ekf_slam

PLUGINLIB_EXPORT_CLASS(vi_ekf_slam::SlamNodelet, nodelet::Nodelet)

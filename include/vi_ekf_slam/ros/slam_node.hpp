#pragma once

#include <ros/ros.h>
#include <std_srvs/Empty.h>
#include <std_srvs/Trigger.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/run_writer.hpp"
#include "vi_ekf_slam/ros/diagnostics.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/output_sequencer.hpp"
#include "vi_ekf_slam/ros/publishers.hpp"

namespace vi_ekf_slam {

/// Connects topics, services and parameters to Intake, SlamSystem, Publishers and RunWriter. All callbacks
/// must run in one thread (the global queue of the node, the single-threaded queue of the nodelet).
class SlamNode {
 public:
  /// Throws ConfigError (or std::runtime_error when output_dir cannot be made): the node must not start then.
  SlamNode(ros::NodeHandle nh, ros::NodeHandle private_nh);
  /// Calls finish().
  ~SlamNode();
  SlamNode(const SlamNode&) = delete;
  SlamNode& operator=(const SlamNode&) = delete;

  /// The data are over: processes what is still held and saves everything. A second call does nothing.
  void finish();

 private:
  struct Settings {
    FullConfig config;
    std::string source;     ///< where the parameters are, for messages
    std::string output_dir; ///< absolute; empty: nothing is saved
  };

  static Settings readSettings(const ros::NodeHandle& private_nh);
  static InputTopics resolvedTopics(const ros::NodeHandle& nh);

  void connectSystem();
  void subscribe();
  template <typename Message>
  void takeMeasurement(const Message& message, Stream stream);
  void onImu(const sensor_msgs::Imu& message);
  void onVelocity(const geometry_msgs::TwistWithCovarianceStamped& message);
  void onFeatures(const StereoFeatureArray& message);
  void onLeftInfo(const sensor_msgs::CameraInfo& message);
  void onRightInfo(const sensor_msgs::CameraInfo& message);
  void onTransforms(const tf2_msgs::TFMessage& message);
  void onStaticTransforms(const tf2_msgs::TFMessage& message);
  void handleOutput(const Output& output, bool is_frame);
  void handleReset(const std::string& reason);
  void checkHealth(const ros::WallTimerEvent& event);
  void save();
  bool saveService(const std::function<void()>& write, std_srvs::Trigger::Response& response) const;
  bool serveReset(std_srvs::Empty::Request& request, std_srvs::Empty::Response& response);
  bool serveSaveTrajectory(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);
  bool serveSaveMap(std_srvs::Trigger::Request& request, std_srvs::Trigger::Response& response);

  ros::NodeHandle nh_;
  ros::NodeHandle private_nh_;
  Settings settings_;
  SlamSystem system_;
  Intake intake_;
  OutputSequencer sequencer_;
  Publishers publishers_;
  Diagnostics diagnostics_;
  RunWriter writer_;
  ros::WallTime start_;
  ros::WallTime last_warning_;
  std::map<std::string, std::uint64_t> warned_turned_away_;
  bool finished_ = false;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer health_timer_;
};

} // namespace vi_ekf_slam

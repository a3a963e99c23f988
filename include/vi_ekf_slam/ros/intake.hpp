#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"
#include "vi_ekf_slam/ros/rig_assembler.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Names of the inputs.
struct InputTopics {
  std::string imu = "imu";
  std::string velocity = "velocity";
  std::string twist_bias = "twist_bias";
  std::string features = "features";
  std::string left_info = "left/camera_info";
  std::string right_info = "right/camera_info";
};

/// The one path from messages into SlamSystem, for the node and run_bag alike: converts, checks, counts what
/// it turns away, and hands over the calibration as soon as it is complete.
class Intake {
 public:
  /// `system` must outlive this.
  Intake(SlamSystem& system, const RosConfig& config, const InputTopics& topics);

  void add(const sensor_msgs::Imu& message);
  void add(const geometry_msgs::TwistWithCovarianceStamped& message);
  void add(const StereoFeatureArray& message);
  /// What is known of the biases of imu and velocity beforehand; best before the first of them.
  void addTwistBias(const geometry_msgs::TwistWithCovarianceStamped& message);
  void addLeftInfo(const sensor_msgs::CameraInfo& message);
  void addRightInfo(const sensor_msgs::CameraInfo& message);
  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static);

  const RigAssembler& rigAssembler() const { return rig_; }
  /// Empty until the first message said it, unless configured.
  const std::string& imuFrame() const { return imu_frame_; }
  /// Messages of the three measurement streams, used or not.
  std::uint64_t received() const;
  /// Topics of required inputs (imu, velocity and, where the estimator uses them, features) from which no
  /// message has come, with commas; empty: there is none.
  std::string missingInputs() const;
  /// Messages (and repeated ids) turned away, by "input: reason".
  const std::map<std::string, std::uint64_t>& turnedAway() const { return turned_away_; }
  /// Features taken that have no depth.
  std::uint64_t withoutDisparity() const { return without_disparity_; }
  /// Features that the next message may have beside `max_features` of the configuration; for a busy node.
  void limitFeatures(std::size_t limit) { feature_limit_ = limit; }
  /// Features left out because of limitFeatures.
  std::uint64_t shedFeatures() const { return shed_features_; }

 private:
  void learnImuFrame(const std::string& frame_id);
  void turnAway(const char* input, conversions::Rejection rejection);
  void turnAway(const char* reason, std::size_t count);
  void offerRig();

  SlamSystem& system_;
  InputTopics topics_;
  std::string imu_frame_;
  RigAssembler rig_;
  std::array<std::uint64_t, kStreamCount> received_{};
  std::map<std::string, std::uint64_t> turned_away_;
  std::uint64_t without_disparity_ = 0;
  std::size_t max_features_;
  std::size_t feature_limit_;
  std::uint64_t shed_features_ = 0;
};

} // namespace vi_ekf_slam

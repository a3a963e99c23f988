#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "vi_ekf_slam/core/sensors/stereo_check.hpp"
#include "vi_ekf_slam/core/slam/slam_system.hpp"
#include "vi_ekf_slam/ros/conversions.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"
#include "vi_ekf_slam/ros/input/rig_assembler.hpp"
#include "vi_ekf_slam/ros/input/velocity_frames.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// Names of the inputs.
struct InputTopics {
  std::string imu = "imu";
  std::string velocity = "velocity";
  std::string wheel_odometry = "wheel_odometry";
  std::string twist_bias = "twist_bias";
  std::string features = "features";
  std::string left_info = "left/camera_info";
  std::string right_info = "right/camera_info";
};

/// The one path from messages into SlamSystem, for the node and run_bag alike: converts, checks, counts what
/// it turns away, and hands over the calibration as soon as it is complete.
///
/// The IMU's messages say what the IMU's frame is. Where neither they nor velocities come for as long as the
/// calibration is waited for, what moves is the left camera, until an IMU comes. A velocity may be of any
/// frame of the vehicle; the first one waits for the transform that carries it to the IMU, and all that comes
/// after it, for as long as measurements wait for the calibration.
class Intake {
 public:
  /// `system` must outlive this.
  Intake(SlamSystem& system, const RosConfig& config, const InputTopics& topics);

  void add(const sensor_msgs::Imu& message);
  void add(const geometry_msgs::TwistWithCovarianceStamped& message);
  /// Wheel odometry, whose twist is a velocity too.
  void add(const nav_msgs::Odometry& message);
  void add(const StereoFeatureArray& message);
  /// What is known of the biases of imu and velocity beforehand; best before the first of them.
  void addTwistBias(const geometry_msgs::TwistWithCovarianceStamped& message);
  void addLeftInfo(const sensor_msgs::CameraInfo& message);
  void addRightInfo(const sensor_msgs::CameraInfo& message);
  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static);

  /// Nothing waits any longer: the data are over.
  void flush();
  /// Time begins anew.
  void restartTransforms() { frames_.restart(); }
  /// Called once for each frame (with its input) that cannot be used: its name, and what to do.
  void onProblem(std::function<void(const std::string&)> handler) { handler_ = std::move(handler); }

  const InputTopics& topics() const { return topics_; }
  const FrameTree& frames() const { return frames_; }
  /// Whether features are those of a rectified pair.
  const StereoCheck& stereoCheck() const { return stereo_check_; }
  const RigAssembler& rigAssembler() const { return rig_; }
  /// Of what moves. Empty until the first IMU message said it, or a camera is alone, unless configured.
  const std::string& imuFrame() const { return imu_frame_; }
  /// Messages of the three measurement streams, used or not.
  std::uint64_t received() const;
  /// Whether the estimator cannot do without the stream, by what has come up to now and has a topic.
  bool isRequired(Stream stream) const;
  /// Topics of required inputs from which no message has come, with commas; empty: there is none.
  std::string missingInputs() const;
  /// Those from which messages have come and none has been processed, once all are; the same way.
  std::string unusedInputs() const;
  /// Messages (and repeated ids) turned away, here or for their values by the system, by "input: reason".
  std::map<std::string, std::uint64_t> turnedAway() const;
  /// Features taken that have no depth.
  std::uint64_t withoutDisparity() const { return counts_.without_disparity; }
  /// Features that the next message may have beside `max_features` of the configuration; for a busy node.
  void limitFeatures(std::size_t limit) { feature_limit_ = limit; }
  /// Features left out because of limitFeatures.
  std::uint64_t shedFeatures() const { return counts_.shed_features; }

 private:
  struct Arrival {
    Measurement measurement;
    std::string frame; ///< of a velocity
  };

  struct Counts {
    std::array<std::uint64_t, kStreamCount> received{};
    std::uint64_t without_disparity = 0, shed_features = 0;
    std::map<std::string, std::uint64_t> turned_away;
  };

  std::string topicsOf(Stream stream) const;
  template <typename Condition>
  std::string requiredInputs(const Condition& condition) const;
  void hand(Arrival arrival);
  void release(bool at_once);
  bool hasWaited(const Arrival& arrival) const;
  void addVelocity(conversions::Converted<VelocitySample> converted, const std::string& frame_id);
  void learnImuFrame(const std::string& frame_id);
  bool isCameraAlone() const;
  void takeCameraForBody();
  bool takeImuForBody(const std::string& imu_frame);
  void report(const std::string& frame, const std::string& problem);
  void turnAway(const char* input, conversions::Rejection rejection);
  void turnAway(const char* reason, std::size_t count);
  void offerRig();

  SlamSystem& system_;
  InputTopics topics_;
  std::string imu_frame_;
  bool camera_is_body_ = false; ///< since nothing else came
  std::optional<Stamp> first_frame_;
  FrameTree frames_;
  RigAssembler rig_;
  VelocityFrames velocities_;
  std::deque<Arrival> waiting_;    ///< in the order in which they came; the first is a velocity
  bool may_wait_ = true;           ///< only the first velocity does: later ones are not to hold up what runs
  std::set<std::string> reported_; ///< frames, with their inputs
  std::function<void(const std::string&)> handler_;
  StereoCheck stereo_check_;
  Counts counts_;
  std::size_t max_features_;
  std::size_t feature_limit_;
};

} // namespace vi_ekf_slam

#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Imu.h>
#include <tf2_msgs/TFMessage.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "vi_ekf_slam/StereoFeatureArray.h"
#include "vi_ekf_slam/front_end/front_end.hpp"
#include "vi_ekf_slam/front_end/image_pairing.hpp"
#include "vi_ekf_slam/ros/front_end/image_decoder.hpp"
#include "vi_ekf_slam/ros/input/frame_tree.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {

/// The calibration that the two camera_infos describe; nothing, and in `problem` a sentence that names topic,
/// field, value and what is allowed, where they describe none.
std::optional<StereoCalibration> stereoCalibration(const sensor_msgs::CameraInfo& left,
                                                   const sensor_msgs::CameraInfo& right, ImageKind images,
                                                   const InputTopics& topics, std::string& problem);

/// The one path from messages with images to features, for the node, the nodelet and run_bag alike: pairs and
/// decodes, puts the calibration together, counts what it turns away.
class ImageIntake {
 public:
  using FeatureHandler = std::function<void(const StereoFeatureArray&)>;
  using PairHandler = std::function<void(const StereoImages&, const FrontEnd&)>;

  /// Names of the topics are for messages; an empty imu topic: there is none. `on_features` hears of every
  /// pair.
  ImageIntake(const FullConfig& config, const InputTopics& topics, FeatureHandler on_features);

  void addLeft(const sensor_msgs::ImageConstPtr& message) { pairing_.addLeft(pending(message)); }
  void addRight(const sensor_msgs::ImageConstPtr& message) { pairing_.addRight(pending(message)); }
  void addLeft(const sensor_msgs::CompressedImageConstPtr& message) { pairing_.addLeft(pending(message)); }
  void addRight(const sensor_msgs::CompressedImageConstPtr& message) { pairing_.addRight(pending(message)); }
  void addLeftInfo(const sensor_msgs::CameraInfo& message);
  void addRightInfo(const sensor_msgs::CameraInfo& message);
  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static);
  void add(const sensor_msgs::Imu& message);

  /// Called with each pair's images once it is processed.
  void onPair(PairHandler handler) { on_pair_ = std::move(handler); }
  /// Called once, with a sentence, when the calibration is known.
  void onCalibration(std::function<void(const std::string&)> handler) {
    on_calibration_ = std::move(handler);
  }

  /// Processes the oldest pair that is complete; false: there is none.
  bool processNext() { return process(pairing_.pop()); }
  /// Processes the newest one, and gives up those before it.
  bool processNewest() { return process(pairing_.popNewest()); }
  /// The data are over: nothing waits any longer.
  void close() { pairing_.close(); }

  /// Left optical frame; empty as long as there is no calibration.
  const std::string& leftFrame() const { return left_frame_; }
  std::size_t wantedFeatures() const { return config_.front_end.features; }
  /// Nothing as long as there is no calibration.
  const FrontEnd* frontEnd() const { return front_end_.get(); }
  /// Why no images are used; empty: nothing is wrong, or not known yet.
  std::string problem() const;
  /// What most of the pairs were of no or little use for, and how many they were; empty: nothing.
  std::string mostlyWrong() const;
  /// Pairs processed.
  std::uint64_t pairs() const { return pairs_; }
  /// Features that went out.
  std::uint64_t features() const { return features_; }
  /// Pairs given up for newer ones.
  std::uint64_t shed() const { return pairing_.counts().shed; }
  /// s of CPU time that the last pair took, without decoding.
  double lastSeconds() const { return last_seconds_; }
  /// Images and pairs that were of no or little use, by "images: reason".
  std::map<std::string, std::uint64_t> turnedAway() const;

 private:
  template <typename MessagePtr>
  PendingImage pending(const MessagePtr& message);
  bool process(std::optional<PendingPair> pair);
  cv::Mat decode(const PendingImage& image, const char* side);
  void calibrate();
  void updateHold();
  void updateTransform();

  FullConfig config_;
  InputTopics topics_;
  FeatureHandler on_features_;
  PairHandler on_pair_;
  std::function<void(const std::string&)> on_calibration_;
  ImagePairing pairing_;
  ImageDecoder decoder_;
  FrameTree frames_;
  std::string imu_frame_, left_frame_, calibration_problem_;
  std::optional<sensor_msgs::CameraInfo> left_info_, right_info_;
  Eigen::Matrix3d rectification_ = Eigen::Matrix3d::Identity();
  bool has_rotation_ = false;   ///< the front end knows how the camera sits on the IMU
  bool waits_for_rotation_;     ///< pairs wait for that
  std::deque<ImuSample> early_; ///< before the front end was there
  std::unique_ptr<FrontEnd> front_end_;
  std::uint64_t pairs_ = 0, features_ = 0;
  double last_seconds_ = 0.0;
  std::map<std::string, std::uint64_t> turned_away_;
};

} // namespace vi_ekf_slam

#pragma once

#include <sensor_msgs/Imu.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "vi_ekf_slam/StereoFeatureArray.h"
#include "vi_ekf_slam/front_end/front_end.hpp"
#include "vi_ekf_slam/front_end/image_pairing.hpp"
#include "vi_ekf_slam/ros/front_end/image_decoder.hpp"
#include "vi_ekf_slam/ros/front_end/pair_calibration.hpp"

namespace vi_ekf_slam {

/// The one path from messages with images to features, for the node, the nodelet and run_bag alike: pairs and
/// decodes, waits for the calibration, counts what it turns away.
class ImageIntake {
 public:
  using FeatureHandler = std::function<void(const StereoFeatureArray&)>;
  using PairHandler = std::function<void(const StereoImages&, const FrontEnd&)>;

  /// Names of the topics are for messages; an empty imu topic: there is none. `on_features` hears of every
  /// pair.
  ImageIntake(const FullConfig& config, const InputTopics& topics, FeatureHandler on_features);

  /// Raw or compressed images, by sensor_msgs' shared pointers to constant ones.
  template <typename MessagePtr>
  void addLeft(const MessagePtr& message) {
    pairing_.addLeft(pending(message));
  }
  template <typename MessagePtr>
  void addRight(const MessagePtr& message) {
    pairing_.addRight(pending(message));
  }
  void addLeftInfo(const sensor_msgs::CameraInfo& message) {
    calibration_.addLeft(message);
    begin();
  }
  void addRightInfo(const sensor_msgs::CameraInfo& message) {
    calibration_.addRight(message);
    begin();
  }
  void addTransforms(const tf2_msgs::TFMessage& message, bool is_static);
  void add(const sensor_msgs::Imu& message);

  /// Called with each pair's images once it is processed.
  void onPair(PairHandler handler) { handlers_.pair = std::move(handler); }
  /// Called once, with a sentence, when the calibration is known.
  void onCalibration(std::function<void(const std::string&)> handler) {
    handlers_.calibration = std::move(handler);
  }

  /// Processes the oldest pair that is complete; false: there is none.
  bool processNext() { return process(pairing_.pop()); }
  /// Processes the newest one, and gives up those before it.
  bool processNewest() { return process(pairing_.popNewest()); }
  /// Processes the oldest one for which the gyro has not come far enough: nothing more comes, for now.
  bool processWaiting();
  /// The data are over: nothing waits any longer.
  void close() { pairing_.close(); }

  /// Left optical frame; empty as long as there is no calibration.
  const std::string& leftFrame() const { return calibration_.leftFrame(); }
  std::size_t wantedFeatures() const { return config_.features; }
  /// Nothing as long as there is no calibration.
  const FrontEnd* frontEnd() const { return front_end_.get(); }
  /// Why no images are used; empty: nothing is wrong, or not known yet.
  std::string problem() const;
  /// What most of the pairs were of no or little use for, and how many they were; empty: nothing.
  std::string mostlyWrong() const;
  /// Pairs processed.
  std::uint64_t pairs() const { return counts_.pairs; }
  /// Features that went out.
  std::uint64_t features() const { return counts_.features; }
  /// s of CPU time that the last pair took, without decoding.
  double lastSeconds() const { return last_seconds_; }
  /// Images and pairs that were of no or little use, by "images: reason".
  std::map<std::string, std::uint64_t> turnedAway() const;
  /// Pairs that were used although something is wrong with them, by "images used: what".
  const std::map<std::string, std::uint64_t>& flawed() const { return counts_.flawed; }
  /// What is wrong with the last pair, in words; empty: nothing.
  const std::string& lastProblem() const { return last_problem_; }
  bool lastWasUsed() const { return last_was_used_; }

 private:
  struct Handlers {
    FeatureHandler features;
    PairHandler pair;
    std::function<void(const std::string&)> calibration;
  };
  struct Counts {
    std::uint64_t pairs = 0, features = 0;
    std::map<std::string, std::uint64_t> turned_away, flawed;
  };

  template <typename MessagePtr>
  PendingImage pending(const MessagePtr& message) {
    return {conversions::toStamp(message->header.stamp),
            [this, message] { return decoder_.decode(message); }};
  }
  bool process(std::optional<PendingPair> pair);
  cv::Mat decode(const PendingImage& image, const char* side);
  void begin();
  void updateRotation();
  void updateHold();

  FrontEndConfig config_;
  Handlers handlers_;
  ImagePairing pairing_;
  ImageDecoder decoder_;
  PairCalibration calibration_;
  bool waits_for_rotation_; ///< pairs do, for how the camera sits on the IMU
  bool gyro_has_begun_ = false;
  std::deque<ImuSample> early_; ///< before the front end was there
  std::unique_ptr<FrontEnd> front_end_;
  Counts counts_;
  double last_seconds_ = 0.0;
  std::string last_problem_;
  bool last_was_used_ = true;
};

} // namespace vi_ekf_slam

#pragma once

#include <rosbag/bag.h>

#include <string>

#include "vi_ekf_slam/ros/input/bag_reader.hpp"
#include "vi_ekf_slam/ros/intake.hpp"

namespace vi_ekf_slam {

/// A bag with features in the place of the images that they were made of. It appears under its name when it
/// is complete.
class FeatureBag {
 public:
  /// Throws std::runtime_error, which names the file, where it cannot be made; so do the others.
  FeatureBag(const std::string& path, const InputTopics& topics);
  ~FeatureBag();
  FeatureBag(const FeatureBag&) = delete;
  FeatureBag& operator=(const FeatureBag&) = delete;

  /// Takes over a message that is an input of the estimator; others are left out.
  void copy(const BagMessage& message);
  /// `time`: ns, of recording.
  void write(const StereoFeatureArray& features, std::uint64_t time);
  void finish();

 private:
  template <typename Message>
  void put(const std::string& topic, std::uint64_t time, const Message& message, bool is_latched);
  template <typename Action>
  void guard(const Action& action);

  std::string path_, temporary_;
  InputTopics topics_;
  rosbag::Bag bag_;
  bool is_finished_ = false;
};

} // namespace vi_ekf_slam

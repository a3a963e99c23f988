#pragma once

#include <string>

#include "vi_ekf_slam/ros/input/bag_reader.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/output/bag_writer.hpp"

namespace vi_ekf_slam {

/// A bag with features in the place of the images that they were made of. It appears under its name when it
/// is complete.
class FeatureBag {
 public:
  /// Throws BagWriteError, and so do the others.
  FeatureBag(const std::string& path, const InputTopics& topics) : bag_(path), topics_(topics) {}

  /// Takes over a message that is an input of the estimator; others are left out.
  void copy(const BagMessage& message);
  /// `time`: ns, of recording.
  void write(const StereoFeatureArray& features, std::uint64_t time);
  void finish() { bag_.finish(); }

 private:
  template <typename Message>
  void put(const std::string& topic, std::uint64_t time, const Message& message, bool is_latched);

  BagWriter bag_;
  InputTopics topics_;
};

} // namespace vi_ekf_slam

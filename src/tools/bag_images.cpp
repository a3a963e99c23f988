#include "bag_images.hpp"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <iomanip>

namespace vi_ekf_slam {

bool BagImages::isNeeded(const RunBagOptions& options, const BagInput& input) {
  return input.hasImages(options.left_image) && input.hasImages(options.right_image) &&
         !input.has(options.topics.features);
}

BagImages::BagImages(const RunBagOptions& options, const FullConfig& config, BagInput& input, Intake& intake)
    : input_(input), images_(config, options.topics, [this, &intake](const StereoFeatureArray& features) {
        seconds_ += images_.lastSeconds();
        if (saved_) saved_->write(features, time_);
        intake.add(features);
      }) {
  if (!options.save_features.empty())
    saved_ = std::make_unique<FeatureBag>(options.save_features, options.topics);
  images_.onPair([this](const StereoImages&, const FrontEnd& front_end) {
    tracks_ += static_cast<double>(front_end.tracks().size());
    life_s_ += front_end.report().mean_life_s;
  });
  listenToImages(options.left_image, true);
  listenToImages(options.right_image, false);
  const InputTopics& topics = options.topics;
  input.listen<sensor_msgs::CameraInfo>(topics.left_info, [this](const auto& m) { images_.addLeftInfo(m); });
  input.listen<sensor_msgs::CameraInfo>(topics.right_info,
                                        [this](const auto& m) { images_.addRightInfo(m); });
  input.listen<sensor_msgs::Imu>(topics.imu, [this](const auto& m) { images_.add(m); });
  for (const bool is_static : {true, false}) {
    input.listen<tf2_msgs::TFMessage>(is_static ? "/tf_static" : "/tf", [this, is_static](const auto& m) {
      images_.addTransforms(m, is_static);
    });
  }
  // Once the intake has the message too, as the node's front end answers after it.
  input.onMessage([this](const BagMessage& message) {
    time_ = message.time;
    if (saved_) saved_->copy(message);
    advance();
  });
}

void BagImages::listenToImages(const std::string& topic, bool is_left) {
  const auto add = [this, is_left](const auto& message) {
    const auto shared = boost::make_shared<const std::decay_t<decltype(message)>>(message);
    is_left ? images_.addLeft(shared) : images_.addRight(shared);
  };
  if (input_.has(topic)) {
    input_.listen<sensor_msgs::Image>(topic, add);
  } else {
    input_.listen<sensor_msgs::CompressedImage>(topic + "/compressed", add);
  }
}

void BagImages::advance() {
  while (images_.processNext()) continue;
}

void BagImages::finish() {
  images_.close();
  advance();
  if (saved_) saved_->finish();
}

void BagImages::print(std::ostream& out) const {
  const double pairs = static_cast<double>(std::max<std::uint64_t>(1, images_.pairs()));
  const double features = static_cast<double>(images_.features());
  out << "front end: " << images_.pairs() << " pairs, " << images_.features() << " features" << std::fixed
      << std::setprecision(1) << ", " << features / pairs << " a pair, of "
      << 100.0 * features / std::max(1.0, tracks_) << " % of the tracks, which are " << std::setprecision(2)
      << life_s_ / pairs << " s old; " << 1e3 * seconds_ / pairs << " ms of CPU a pair" << std::defaultfloat
      << std::endl;
  for (const auto& [reason, count] : images_.flawed()) out << reason << ": " << count << std::endl;
}

} // namespace vi_ekf_slam

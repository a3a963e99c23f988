#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>

#include "vi_ekf_slam/ros/input/bag_reader.hpp"
#include "vi_ekf_slam/ros/intake.hpp"
#include "vi_ekf_slam/ros/wire_check.hpp"

namespace vi_ekf_slam {

/// The inputs in a bag, in the order of recording.
class BagInput {
 public:
  /// Opens the bag and checks that it has a measurement topic of the right type. Throws BagError.
  BagInput(const std::string& path, const InputTopics& topics);

  /// Whether the bag has the topic.
  bool has(const std::string& topic) const;
  /// The same of images, which may be compressed ones on TOPIC/compressed.
  bool hasImages(const std::string& topic) const { return has(topic) || has(topic + "/compressed"); }
  /// `use` gets the messages of the topic too, before `intake` does. Throws BagError where the bag's topic
  /// has another type.
  template <typename Message, typename Use>
  void listen(const std::string& topic, const Use& use) {
    requireType(topic, ros::message_traits::datatype<Message>());
    listeners_[topic] = [use](const BagMessage& message) { use(wire::read<Message>(message)); };
  }
  /// `handler` hears of every message, after the others.
  void onMessage(std::function<void(const BagMessage&)> handler) { on_message_ = std::move(handler); }

  /// Hands every message to `intake`. After each, `proceed` hears the share done (0 to 1) and says whether to
  /// go on. Throws BagError where the bag cannot be read on.
  void feed(Intake& intake, const std::function<bool(double)>& proceed);

 private:
  /// Of a topic: the type that it must have, and who takes its messages.
  struct Input {
    std::string type;
    std::function<void(const BagMessage&, Intake&)> use;
  };

  template <typename Message, typename Use>
  static Input of(const Use& use);
  std::map<std::string, Input> inputs() const;
  void requireType(const std::string& topic, const std::string& type) const;

  std::map<std::string, std::function<void(const BagMessage&)>> listeners_;
  std::function<void(const BagMessage&)> on_message_;
  std::string path_;
  InputTopics topics_;
  BagReader bag_;
};

} // namespace vi_ekf_slam

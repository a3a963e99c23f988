#include "bag_input.hpp"

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>

#include "vi_ekf_slam/ros/output/bag_writer.hpp"

namespace vi_ekf_slam {
namespace {

std::string listOf(const std::map<std::uint32_t, BagConnection>& connections) {
  std::set<std::string> lines;
  for (const auto& [id, connection] : connections)
    lines.insert("\n  " + connection.topic + " (" + connection.type + ")");
  if (lines.empty()) return " nothing";
  std::string text;
  for (const auto& line : lines) text += line;
  return text;
}

} // namespace

BagInput::BagInput(const std::string& path, const InputTopics& topics)
    : path_(path), topics_(topics), bag_(path) {
  for (const auto& [topic, input] : inputs()) requireType(topic, input.type);
  bool usable = false;
  for (const auto& [id, connection] : bag_.connections()) {
    usable = usable || connection.topic == topics_.imu || connection.topic == topics_.velocity ||
             connection.topic == topics_.wheel_odometry || connection.topic == topics_.features ||
             connection.type == "sensor_msgs/Image" || connection.type == "sensor_msgs/CompressedImage";
  }
  if (usable) return;
  throw BagError(path_ + ": none of " + topics_.imu + ", " + topics_.velocity + ", " + topics_.features +
                 " is in the bag (see --imu and so on); it has:" + listOf(bag_.connections()));
}

void BagInput::requireType(const std::string& topic, const std::string& type) const {
  for (const auto& [id, connection] : bag_.connections()) {
    if (connection.topic == topic && connection.type != type)
      throw BagError(path_ + ": " + topic + " is " + connection.type + ", it must be " + type);
  }
}

bool BagInput::has(const std::string& topic) const {
  const auto& all = bag_.connections();
  return std::any_of(all.begin(), all.end(), [&](const auto& c) { return c.second.topic == topic; });
}

template <typename Message, typename Use>
BagInput::Input BagInput::of(const Use& use) {
  return {ros::message_traits::datatype<Message>(),
          [use](const BagMessage& m, Intake& intake) { use(wire::read<Message>(m), intake); }};
}

std::map<std::string, BagInput::Input> BagInput::inputs() const {
  const auto add = [](const auto& m, Intake& in) { in.add(m); };
  const auto bias = [](const auto& m, Intake& in) { in.addTwistBias(m); };
  const auto left = [](const auto& m, Intake& in) { in.addLeftInfo(m); };
  const auto right = [](const auto& m, Intake& in) { in.addRightInfo(m); };
  const auto moving = [](const auto& m, Intake& in) { in.addTransforms(m, false); };
  const auto fixed = [](const auto& m, Intake& in) { in.addTransforms(m, true); };
  return {{topics_.imu, of<sensor_msgs::Imu>(add)},
          {topics_.velocity, of<geometry_msgs::TwistWithCovarianceStamped>(add)},
          {topics_.wheel_odometry, of<nav_msgs::Odometry>(add)},
          {topics_.twist_bias, of<geometry_msgs::TwistWithCovarianceStamped>(bias)},
          {topics_.features, of<StereoFeatureArray>(add)},
          {topics_.left_info, of<sensor_msgs::CameraInfo>(left)},
          {topics_.right_info, of<sensor_msgs::CameraInfo>(right)},
          {"/tf", of<tf2_msgs::TFMessage>(moving)},
          {"/tf_static", of<tf2_msgs::TFMessage>(fixed)}};
}

void BagInput::feed(Intake& intake, const std::function<bool(double)>& proceed) {
  const std::map<std::string, Input> inputs = this->inputs();
  std::set<std::string> names;
  for (const auto& [name, input] : inputs) names.insert(name);
  for (const auto& [name, listener] : listeners_) names.insert(name);
  try {
    bag_.forEach(names, [&](const BagMessage& message, double done) {
      const std::string& topic = message.connection.topic;
      const auto listener = listeners_.find(topic);
      if (listener != listeners_.end()) listener->second(message);
      const auto input = inputs.find(topic);
      if (input != inputs.end()) input->second.use(message, intake);
      if (on_message_) on_message_(message);
      return proceed(done);
    });
  } catch (const BagError&) {
    throw;
  } catch (const BagWriteError&) { // of what a handler writes
    throw;
  } catch (const std::exception& e) { // bytes that are no such message
    throw BagError(path_ + ": cannot be read on: " + e.what());
  }
}

} // namespace vi_ekf_slam

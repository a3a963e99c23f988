#include "bag_input.hpp"

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>

#include "vi_ekf_slam/ros/wire_check.hpp"

namespace vi_ekf_slam {
namespace {

template <typename Message>
const char* typeOf() {
  return ros::message_traits::datatype<Message>();
}

/// Topic -> type that it must have.
std::map<std::string, std::string> expectedTypes(const InputTopics& t) {
  return {{t.imu, typeOf<sensor_msgs::Imu>()},
          {t.velocity, typeOf<geometry_msgs::TwistWithCovarianceStamped>()},
          {t.wheel_odometry, typeOf<nav_msgs::Odometry>()},
          {t.twist_bias, typeOf<geometry_msgs::TwistWithCovarianceStamped>()},
          {t.features, typeOf<StereoFeatureArray>()},
          {t.left_info, typeOf<sensor_msgs::CameraInfo>()},
          {t.right_info, typeOf<sensor_msgs::CameraInfo>()},
          {"/tf", typeOf<tf2_msgs::TFMessage>()},
          {"/tf_static", typeOf<tf2_msgs::TFMessage>()}};
}

std::string listOf(const std::map<std::uint32_t, BagConnection>& connections) {
  std::set<std::string> lines;
  for (const auto& [id, connection] : connections)
    lines.insert("\n  " + connection.topic + " (" + connection.type + ")");
  if (lines.empty()) return " nothing";
  std::string text;
  for (const auto& line : lines) text += line;
  return text;
}

/// Calls `use` with the message, or throws if the bag's definition of the type is another one.
template <typename Message, typename Use>
void instantiate(const BagMessage& message, const Use& use) {
  use(wire::read<Message>(message));
}

} // namespace

BagInput::BagInput(const std::string& path, const InputTopics& topics)
    : path_(path), topics_(topics), bag_(path) {
  const auto expected = expectedTypes(topics_);
  for (const auto& [topic, type] : expected) requireType(topic, type);
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

void BagInput::listen(const std::string& topic, const std::string& type,
                      std::function<void(const BagMessage&)> handler) {
  requireType(topic, type);
  listeners_[topic] = std::move(handler);
}

BagInput::Handler BagInput::handlerFor(const std::string& topic) const {
  const auto measurement = [](const auto& message, Intake& intake) { intake.add(message); };
  if (topic == topics_.imu) {
    return [=](const auto& m, Intake& in) {
      instantiate<sensor_msgs::Imu>(m, [&](const auto& x) { measurement(x, in); });
    };
  }
  if (topic == topics_.velocity) {
    return [=](const auto& m, Intake& in) {
      instantiate<geometry_msgs::TwistWithCovarianceStamped>(m, [&](const auto& x) { measurement(x, in); });
    };
  }
  if (topic == topics_.wheel_odometry) {
    return [=](const auto& m, Intake& in) {
      instantiate<nav_msgs::Odometry>(m, [&](const auto& x) { measurement(x, in); });
    };
  }
  if (topic == topics_.twist_bias) {
    return [](const auto& m, Intake& in) {
      instantiate<geometry_msgs::TwistWithCovarianceStamped>(m, [&](const auto& x) { in.addTwistBias(x); });
    };
  }
  if (topic == topics_.features) {
    return [=](const auto& m, Intake& in) {
      instantiate<StereoFeatureArray>(m, [&](const auto& x) { measurement(x, in); });
    };
  }
  if (topic == topics_.left_info) {
    return [](const auto& m, Intake& in) {
      instantiate<sensor_msgs::CameraInfo>(m, [&](const auto& x) { in.addLeftInfo(x); });
    };
  }
  if (topic == topics_.right_info) {
    return [](const auto& m, Intake& in) {
      instantiate<sensor_msgs::CameraInfo>(m, [&](const auto& x) { in.addRightInfo(x); });
    };
  }
  const bool is_static = topic == "/tf_static";
  return [is_static](const auto& m, Intake& in) {
    instantiate<tf2_msgs::TFMessage>(m, [&](const auto& x) { in.addTransforms(x, is_static); });
  };
}

void BagInput::feed(Intake& intake, const std::function<bool(double)>& proceed) {
  std::map<std::string, Handler> handlers;
  std::set<std::string> names;
  for (const auto& [name, type] : expectedTypes(topics_)) {
    handlers[name] = handlerFor(name);
    names.insert(name);
  }
  for (const auto& [name, listener] : listeners_) names.insert(name);
  try {
    bag_.forEach(names, [&](const BagMessage& message, double done) {
      const std::string& topic = message.connection.topic;
      const auto listener = listeners_.find(topic);
      if (listener != listeners_.end()) listener->second(message);
      const auto handler = handlers.find(topic);
      if (handler != handlers.end()) handler->second(message, intake);
      if (on_message_) on_message_(message);
      return proceed(done);
    });
  } catch (const BagError&) {
    throw;
  } catch (const std::exception& e) { // bytes that are no such message
    throw BagError(path_ + ": cannot be read on: " + e.what());
  }
}

} // namespace vi_ekf_slam

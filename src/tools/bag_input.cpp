#include "bag_input.hpp"

#include <map>
#include <set>
#include <vector>

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

std::string listOf(const rosbag::View& view) {
  std::set<std::string> lines;
  // getConnections is not const in rosbag, though it changes nothing.
  for (const auto* c : const_cast<rosbag::View&>(view).getConnections()) {
    lines.insert("\n  " + c->topic + " (" + c->datatype + ")");
  }
  if (lines.empty()) return " nothing";
  std::string text;
  for (const auto& line : lines) text += line;
  return text;
}

/// Calls `use` with the message, or throws if the bag's definition of the type is another one.
template <typename Message, typename Use>
void instantiate(const rosbag::MessageInstance& instance, const Use& use) {
  use(wire::read<Message>(instance));
}

} // namespace

BagInput::BagInput(const std::string& path, const InputTopics& topics) : path_(path), topics_(topics) {
  openCheckedBag(bag_, path);
  std::vector<std::string> names;
  for (const auto& expected : expectedTypes(topics_)) names.push_back(expected.first);
  try {
    checkTopics();
    view_ = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(names));
  } catch (const BagError&) {
    throw;
  } catch (const std::exception& e) {
    throw BagError(path_ + ": is not a bag that can be read: " + e.what());
  }
}

void BagInput::checkTopics() {
  const auto expected = expectedTypes(topics_);
  rosbag::View all(bag_);
  bool usable = false;
  for (const auto* connection : all.getConnections()) {
    const auto found = expected.find(connection->topic);
    if (found == expected.end()) continue;
    if (found->second != connection->datatype) {
      throw BagError(path_ + ": " + connection->topic + " is " + connection->datatype + ", it must be " +
                     found->second);
    }
    usable = usable || connection->topic == topics_.imu || connection->topic == topics_.velocity ||
             connection->topic == topics_.wheel_odometry || connection->topic == topics_.features;
  }
  if (usable) return;
  throw BagError(path_ + ": none of " + topics_.imu + ", " + topics_.velocity + ", " + topics_.features +
                 " is in the bag (see --imu and so on); it has:" + listOf(all));
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
  for (const auto& expected : expectedTypes(topics_)) handlers[expected.first] = handlerFor(expected.first);
  const double total = static_cast<double>(view_->size());
  double done = 0.0;
  try {
    for (const rosbag::MessageInstance& instance : *view_) {
      handlers.at(instance.getTopic())(instance, intake);
      done += 1.0;
      if (!proceed(done / total)) return;
    }
  } catch (const BagError&) {
    throw;
  } catch (const std::exception& e) { // a damaged file can make rosbag throw more than BagException
    throw BagError(path_ + ": cannot be read on: " + e.what());
  }
}

} // namespace vi_ekf_slam

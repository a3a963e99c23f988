#include "vi_ekf_slam/ros/map_file.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>
#include <unordered_map>

#include "vi_ekf_slam/MapDescriptors.h"
#include "vi_ekf_slam/MapLandmark.h"
#include "vi_ekf_slam/MapState.h"
#include "vi_ekf_slam/ros/conversions.hpp"
#include "vi_ekf_slam/ros/input/bag_reader.hpp"
#include "vi_ekf_slam/ros/output/bag_writer.hpp"
#include "vi_ekf_slam/ros/wire_check.hpp"

namespace vi_ekf_slam {
namespace {

constexpr char kStateTopic[] = "map", kLandmarksTopic[] = "landmarks", kDescriptorsTopic[] = "descriptors";
constexpr double kNorm = 1e-6; // of a quaternion's norm from 1
// Of MapState as it was in format 1: pose, twist and its bias, in 18 rows.
constexpr char kFormat1[] = "b8c6e3bae06010c0888cce2f96b7df60";

/// Numbers of the lower triangle above row `end`.
std::uint64_t numbersAbove(Eigen::Index end) { return static_cast<std::uint64_t>(end * (end + 1) / 2); }

/// Rows `begin` to `end` of the lower triangle, one after the other.
template <typename Numbers>
void takeRows(const Eigen::MatrixXd& P, Eigen::Index begin, Eigen::Index end, Numbers& numbers) {
  std::size_t at = 0;
  for (Eigen::Index row = begin; row < end; ++row) {
    for (Eigen::Index column = 0; column <= row; ++column) numbers[at++] = P(row, column);
  }
}

template <typename Numbers>
void putRows(const Numbers& numbers, Eigen::Index begin, Eigen::Index end, Eigen::MatrixXd& P) {
  std::size_t at = 0;
  for (Eigen::Index row = begin; row < end; ++row) {
    for (Eigen::Index column = 0; column <= row; ++column, ++at)
      P(row, column) = P(column, row) = numbers[at];
  }
}

void write(BagWriter& bag, const SavedMap& map, const std::string& map_frame) {
  MapState state;
  state.version = MapState::VERSION;
  state.header = conversions::toHeader(map.stamp, map_frame);
  state.pose = conversions::toPose(map.world_T_imu);
  for (const SavedVariable& variable : map.variables) {
    state.variables.emplace_back();
    state.variables.back().name = variable.name;
    state.variables.back().mean.assign(variable.mean.data(), variable.mean.data() + variable.mean.size());
  }
  state.landmarks = static_cast<std::uint32_t>(map.landmarks.size());
  state.covariance.resize(numbersAbove(map.base()));
  takeRows(map.covariance, 0, map.base(), state.covariance);
  bag.write(kStateTopic, state.header.stamp, state);
  MapLandmark message;
  for (std::size_t i = 0; i < map.landmarks.size(); ++i) {
    const SavedLandmark& landmark = map.landmarks[i];
    message.id = landmark.id;
    message.position = conversions::toPoint(landmark.position);
    message.observations = static_cast<std::uint32_t>(
        std::min<std::size_t>(landmark.observations, std::numeric_limits<std::uint32_t>::max()));
    message.covariance.resize(numbersAbove(map.rowOf(i + 1)) - numbersAbove(map.rowOf(i)));
    takeRows(map.covariance, map.rowOf(i), map.rowOf(i + 1), message.covariance);
    // A bag is read in the order of its times.
    bag.write(kLandmarksTopic, conversions::toTime(map.stamp + 1 + static_cast<Stamp>(i)), message);
  }
  for (const SavedLandmark& landmark : map.landmarks) {
    if (landmark.descriptors.isEmpty()) continue;
    MapDescriptors look;
    look.id = landmark.id;
    for (std::size_t i = 0; i < landmark.descriptors.size(); ++i) {
      const Descriptor& d = landmark.descriptors[i];
      look.descriptors.insert(look.descriptors.end(), d.begin(), d.end());
    }
    bag.write(kDescriptorsTopic, state.header.stamp, look);
  }
}

/// Reads a map message by message.
class Reader {
 public:
  Reader(const std::string& path, std::uint64_t bytes) : path_(path), bytes_(bytes) {}

  void read(const MapState& message) {
    if (message.version != MapState::VERSION)
      refuse(path_, "version", std::to_string(message.version), std::to_string(MapState::VERSION));
    map_.stamp = conversions::toStamp(message.header.stamp);
    const double norm = conversions::toEigen(message.pose.orientation).norm();
    if (!(std::abs(norm - 1.0) <= kNorm))
      refuse(path_, "pose.orientation", "of norm " + std::to_string(norm), "a quaternion of norm 1");
    map_.world_T_imu = conversions::toSE3(message.pose);
    for (const MapVariable& variable : message.variables) {
      map_.variables.push_back(
          {variable.name, Eigen::Map<const Eigen::VectorXd>(
                              variable.mean.data(), static_cast<Eigen::Index>(variable.mean.size()))});
    }
    validate(map_.variables, path_);
    announced_ = message.landmarks;
    if (announced_ > kMaxSavedLandmarks)
      refuse(path_, "landmarks", std::to_string(announced_), "at most " + std::to_string(kMaxSavedLandmarks));
    requireNumbers("covariance", message.covariance.size(), numbersAbove(map_.base()));
    const std::uint64_t needed = sizeof(double) * numbersAbove(map_.rowOf(announced_));
    if (needed > bytes_) {
      refuse(path_, "landmarks", std::to_string(announced_),
             "what a file of " + std::to_string(bytes_) + " bytes can hold (cut short, or compressed?)");
    }
    map_.covariance.resize(map_.rowOf(announced_), map_.rowOf(announced_));
    putRows(message.covariance, 0, map_.base(), map_.covariance);
  }

  void read(const MapLandmark& message) {
    const std::size_t i = map_.landmarks.size();
    const std::string field = "landmarks[" + std::to_string(i) + "]";
    if (i >= announced_)
      refuse(path_, field, "there", "the " + std::to_string(announced_) + " that are announced");
    const Eigen::Index begin = map_.rowOf(i), end = map_.rowOf(i + 1);
    requireNumbers(field + ".covariance", message.covariance.size(), numbersAbove(end) - numbersAbove(begin));
    putRows(message.covariance, begin, end, map_.covariance);
    map_.landmarks.push_back({message.id, conversions::toEigen(message.position), message.observations});
  }

  void read(const MapDescriptors& message) {
    if (index_.empty()) {
      for (std::size_t i = 0; i < map_.landmarks.size(); ++i) index_.emplace(map_.landmarks[i].id, i);
    }
    const auto landmark = index_.find(message.id);
    if (landmark == index_.end())
      refuse(path_, "descriptors.id", std::to_string(message.id), "the id of a landmark");
    DescriptorSet& looks = map_.landmarks[landmark->second].descriptors;
    const std::string field = "descriptors of landmark " + std::to_string(message.id);
    if (!looks.isEmpty()) refuse(path_, field, "there twice", "once");
    Descriptor descriptor;
    const std::size_t bytes = message.descriptors.size(), each = descriptor.size();
    if (bytes == 0 || bytes % each != 0 || bytes > DescriptorSet::kMost * each) {
      refuse(path_, field, std::to_string(bytes) + " bytes",
             "1 to " + std::to_string(DescriptorSet::kMost) + " times " + std::to_string(each) + " bytes");
    }
    for (auto from = message.descriptors.begin(); from != message.descriptors.end();
         from += static_cast<std::ptrdiff_t>(each)) {
      std::copy_n(from, each, descriptor.begin());
      looks.add(descriptor);
    }
  }

  SavedMap finish() {
    if (map_.landmarks.size() != announced_) {
      refuse(path_, "landmarks", std::to_string(map_.landmarks.size()) + " messages",
             "the " + std::to_string(announced_) + " that are announced");
    }
    validate(map_, path_);
    return std::move(map_);
  }

 private:
  void requireNumbers(const std::string& field, std::uint64_t count, std::uint64_t expected) const {
    if (count == expected) return;
    refuse(path_, field, "of " + std::to_string(count) + " numbers", std::to_string(expected) + " numbers");
  }

  std::string path_;
  std::uint64_t bytes_;
  std::size_t announced_ = 0;
  std::unordered_map<FeatureId, std::size_t> index_; ///< where a landmark is, by its id
  SavedMap map_;
};

template <typename Message>
Message messageOf(const std::string& path, const BagMessage& message) {
  const BagConnection& connection = message.connection;
  if (connection.md5 == kFormat1) {
    throw MapError(path + ": written by an older version (format 1), allowed: format " +
                   std::to_string(MapState::VERSION) + "; save it anew");
  }
  if (connection.md5 != ros::message_traits::md5sum<Message>()) {
    refuse(path, "topic " + connection.topic, "of type " + connection.type + " (" + connection.md5 + ")",
           std::string("the type ") + ros::message_traits::datatype<Message>() + " (" +
               ros::message_traits::md5sum<Message>() + ") that this program was built with");
  }
  return wire::read<Message>(message);
}

SavedMap read(const std::string& path) {
  BagReader bag(path);
  if (const std::size_t states = bag.count(kStateTopic); states != 1)
    refuse(path, "topic " + std::string(kStateTopic), "of " + std::to_string(states) + " messages", "one");
  Reader reader(path, std::filesystem::file_size(path));
  const auto readAll = [&](const char* topic, auto type) {
    bag.forEach({topic}, [&](const BagMessage& message, double /*done*/) {
      reader.read(messageOf<decltype(type)>(path, message));
      return true;
    });
  };
  readAll(kStateTopic, MapState());
  readAll(kLandmarksTopic, MapLandmark());
  readAll(kDescriptorsTopic, MapDescriptors());
  return reader.finish();
}

} // namespace

void writeMapFile(const std::string& path, const SavedMap& map, const std::string& map_frame) {
  validate(map, path + " (not written)");
  try {
    BagWriter bag(path);
    write(bag, map, map_frame);
    bag.finish();
  } catch (const std::exception& e) {
    throw MapError(e.what());
  }
}

SavedMap readMapFile(const std::string& path) {
  try {
    return read(path);
  } catch (const MapError&) {
    throw;
  } catch (const BagError& e) {
    throw MapError(e.what());
  } catch (const std::exception& e) { // bytes that are no such message
    throw MapError(path + ": is not a map that can be read: " + e.what());
  }
}

} // namespace vi_ekf_slam

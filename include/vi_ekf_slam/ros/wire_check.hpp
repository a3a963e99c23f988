#pragma once

#include <ros/serialization.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "vi_ekf_slam/MapDescriptors.h"
#include "vi_ekf_slam/MapLandmark.h"
#include "vi_ekf_slam/MapState.h"
#include "vi_ekf_slam/StereoFeatureArray.h"
#include "vi_ekf_slam/ros/input/bag_reader.hpp"

/// roscpp makes room for as many elements as a message's bytes announce before it looks whether they are
/// there: sixteen bytes can ask for a hundred gigabytes. These look first. What a message without arrays
/// holds is bounded anyway.
namespace vi_ekf_slam::wire {

/// Throws unless the array that begins here, of elements of at least `size` bytes, can be within the stream.
/// How many elements it has.
inline std::uint32_t requireArray(ros::serialization::IStream& stream, std::uint32_t size) {
  std::uint32_t count = 0;
  stream.next(count);
  if (count > stream.getLength() / size)
    throw std::runtime_error("a message announces more elements than it holds");
  return count;
}

template <typename Message>
void requireArrays(ros::serialization::IStream /*stream*/, const Message* /*type*/) {}

inline void requireArrays(ros::serialization::IStream stream, const StereoFeatureArray* /*type*/) {
  std_msgs::Header header;
  stream.next(header);
  for (std::uint32_t left = requireArray(stream, 52); left > 0; --left) {
    stream.advance(48); // up to the descriptor
    stream.advance(requireArray(stream, 1));
  }
}

inline void requireArrays(ros::serialization::IStream stream, const tf2_msgs::TFMessage* /*type*/) {
  requireArray(stream, 76); // two empty names, a stamp, seven doubles
}

inline void requireArrays(ros::serialization::IStream stream, const sensor_msgs::CameraInfo* /*type*/) {
  std_msgs::Header header;
  std::uint32_t height = 0, width = 0;
  std::string distortion_model;
  stream.next(header);
  stream.next(height);
  stream.next(width);
  stream.next(distortion_model);
  requireArray(stream, 8); // D
}

inline void requireArrays(ros::serialization::IStream stream, const sensor_msgs::Image* /*type*/) {
  sensor_msgs::Image message;
  stream.next(message.header);
  stream.next(message.height);
  stream.next(message.width);
  stream.next(message.encoding);
  stream.next(message.is_bigendian);
  stream.next(message.step);
  requireArray(stream, 1); // data
}

inline void requireArrays(ros::serialization::IStream stream, const sensor_msgs::CompressedImage* /*type*/) {
  sensor_msgs::CompressedImage message;
  stream.next(message.header);
  stream.next(message.format);
  requireArray(stream, 1); // data
}

inline void requireArrays(ros::serialization::IStream stream, const MapLandmark* /*type*/) {
  MapLandmark::_id_type id = 0;
  MapLandmark::_position_type position;
  MapLandmark::_observations_type observations = 0;
  stream.next(id);
  stream.next(position);
  stream.next(observations);
  requireArray(stream, 8); // covariance
}

inline void requireArrays(ros::serialization::IStream stream, const MapDescriptors* /*type*/) {
  MapDescriptors::_id_type id = 0;
  stream.next(id);
  requireArray(stream, 1); // descriptors
}

inline void requireArrays(ros::serialization::IStream stream, const MapState* /*type*/) {
  MapState message;
  stream.next(message.version);
  stream.next(message.header);
  stream.next(message.pose);
  for (std::uint32_t left = requireArray(stream, 8); left > 0; --left) { // variables
    std::string name;
    stream.next(name);
    stream.advance(8 * requireArray(stream, 8)); // mean
  }
  stream.next(message.landmarks);
  requireArray(stream, 8); // covariance
}

/// The message in `size` bytes. Throws a std::exception when they are not one.
template <typename Message>
Message read(const std::uint8_t* bytes, std::uint32_t size) {
  Message message;
  const ros::serialization::IStream stream(const_cast<std::uint8_t*>(bytes), size); // which only reads
  requireArrays(stream, &message);
  ros::serialization::IStream whole = stream;
  ros::serialization::deserialize(whole, message);
  return message;
}

// Features of older bags: five numbers each, then with a noise and a descriptor too.
inline constexpr const char* kPlainFeatures = "486a1fc9866e2e69fc963c27cc889935";
inline constexpr const char* kFeaturesWithoutWalk = "c13b47c592ae267c90192a45c6eb5f29";
inline StereoFeatureArray readOlderFeatures(const std::uint8_t* bytes, std::uint32_t size, bool is_plain) {
  ros::serialization::IStream stream(const_cast<std::uint8_t*>(bytes), size);
  StereoFeatureArray message;
  stream.next(message.header);
  message.features.resize(requireArray(stream, is_plain ? 40 : 48));
  for (StereoFeature& f : message.features) {
    stream.next(f.id);
    for (double* pixel : {&f.u_left, &f.v_left, &f.u_right, &f.v_right}) stream.next(*pixel);
    if (is_plain) continue;
    stream.next(f.sigma);
    f.descriptor.resize(requireArray(stream, 1));
    if (!f.descriptor.empty())
      std::copy_n(stream.advance(f.descriptor.size()), f.descriptor.size(), f.descriptor.begin());
  }
  return message;
}

/// The message of a bag. Throws BagError when the bag's definition of its type is another one, and
/// std::exception as above.
template <typename Message>
Message read(const BagMessage& message) {
  if constexpr (std::is_same_v<Message, StereoFeatureArray>) {
    const bool is_plain = message.connection.md5 == kPlainFeatures;
    if (is_plain || message.connection.md5 == kFeaturesWithoutWalk)
      return readOlderFeatures(message.data, message.size, is_plain);
  }
  if (message.connection.md5 != ros::message_traits::md5sum<Message>()) {
    throw BagError(message.connection.topic + ": the bag's definition of " + message.connection.type +
                   " is not the one that this program was built with");
  }
  return read<Message>(message.data, message.size);
}

} // namespace vi_ekf_slam::wire

#pragma once

#include <cstddef>
#include <string>

#include "vi_ekf_slam/core/run/parse_config.hpp"

namespace vi_ekf_slam {

/// What poses leave the node with.
enum class OdometryRate { kFrame, kImu };

/// The `ros:` section of the configuration: what only the node needs to know.
struct RosConfig {
  std::string map_frame = "map";
  std::string odom_frame = "odom";
  std::string imu_frame;            ///< empty: the frame_id of the first IMU message
  std::string base_frame;           ///< whose pose goes out; empty: the IMU's
  bool publish_tf = true;           ///< any transform at all
  bool publish_map_tf = true;       ///< map -> odom, the correction
  bool publish_odom_tf = true;      ///< odom -> base, dead reckoning; false: somebody else's on /tf
  bool single_tf = false;           ///< map -> base directly instead of the two
  double transform_tolerance = 0.0; ///< s that map -> odom is stamped later than its measurement
  OdometryRate odometry_rate = OdometryRate::kImu;
  double path_period_s = 0.5;               ///< s of sensor time between publications of a path
  double max_bandwidth_bytes_s = 1000000.0; ///< of each path and map topic; large ones are sent more rarely
  double landmark_period_s = 1.0; ///< s of sensor time between publications of the map; 0: every frame
  std::size_t max_features = 400; ///< taken of one message; an update's cost grows with their cube
  double max_latency_s = 0.3;     ///< s of wall time that a frame may wait; 0: nothing is shed
};

/// What the images are that come.
enum class ImageKind {
  kAuto,      ///< rectified where D, R, K and P of camera_info leave nothing to rectify, else raw
  kRaw,       ///< as the camera took them
  kRectified, ///< whatever D, R and K say: image_proc sends its image_rect with the camera_info of the raw
              ///< image
};

/// The `front_end:` section: the stereo front end, which makes features of images.
struct FrontEndConfig {
  std::size_t features = 130; ///< tracks that are kept up
  ImageKind images = ImageKind::kAuto;
  double pair_tolerance_s = 0.005; ///< s between the stamps of the two images of a pair
};

/// Names of the top-level sections that are not the core's.
inline const char* const kRosSection = "ros";
inline const char* const kFrontEndSection = "front_end";

struct FullConfig {
  Config core;
  RosConfig ros;
  FrontEndConfig front_end;
};

/// Whether a configuration may have this at its top level. What else lies beside it among a node's parameters
/// is somebody else's.
bool isConfigurationKey(const std::string& name);
/// All of one YAML document, the sections `ros:` and `front_end:` as strictly as parseConfig reads the
/// others. Throws ConfigError.
FullConfig parseFullConfig(const YAML::Node& document, const std::string& source,
                           const std::string& folder = {});
/// All of one YAML text. Throws ConfigError.
FullConfig parseFullConfig(const std::string& yaml, const std::string& source);
/// All of one YAML file; what it names is beside it. Throws ConfigError.
FullConfig loadFullConfig(const std::string& path);

} // namespace vi_ekf_slam

#include "vi_ekf_slam/ros/ros_config.hpp"

#include <filesystem>
#include <set>

#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam {
namespace {

void readFrame(YamlSection& section, const std::string& key, bool may_be_empty, std::string& value) {
  section.read(key, value);
  if (!value.empty() && value.front() == '/')
    section.fail(key, value, "a frame name without a leading slash");
  if (value.empty() && !may_be_empty) section.fail(key, "''", "a frame name, not an empty string");
}

RosConfig readRos(YamlSection section) {
  RosConfig c;
  readFrame(section, "map_frame", false, c.map_frame);
  readFrame(section, "odom_frame", false, c.odom_frame);
  readFrame(section, "imu_frame", true, c.imu_frame);
  readFrame(section, "base_frame", true, c.base_frame);
  section.read("publish_tf", c.publish_tf);
  section.read("publish_map_tf", c.publish_map_tf);
  section.read("publish_odom_tf", c.publish_odom_tf);
  section.read("single_tf", c.single_tf);
  section.read("transform_tolerance", Range::closed(0.0, 10.0), c.transform_tolerance);
  section.readChoice<OdometryRate>(
      "odometry_rate", {{"frame", OdometryRate::kFrame}, {"imu", OdometryRate::kImu}}, c.odometry_rate);
  section.read("path_period_s", Range::closed(0.0, 3600.0), c.path_period_s);
  section.read("max_bandwidth_bytes_s", Range::closed(1e3, 1e12), c.max_bandwidth_bytes_s);
  section.read("landmark_period_s", Range::closed(0.0, 3600.0), c.landmark_period_s);
  section.read("max_features", Range::closed(1.0, 1e5), c.max_features);
  section.read("max_latency_s", Range::closed(0.0, 60.0), c.max_latency_s);
  if (c.map_frame == c.odom_frame) section.fail("odom_frame", c.odom_frame, "different from map_frame");
  if (c.imu_frame == c.map_frame || c.imu_frame == c.odom_frame) {
    section.fail("imu_frame", c.imu_frame, "different from map_frame and odom_frame");
  }
  if (c.base_frame == c.map_frame || c.base_frame == c.odom_frame) {
    section.fail("base_frame", c.base_frame, "different from map_frame and odom_frame");
  }
  section.finish();
  return c;
}

FrontEndConfig readFrontEnd(YamlSection section) {
  FrontEndConfig c;
  section.read("features", Range::closed(8.0, 2000.0), c.features);
  section.readChoice<ImageKind>(
      "images", {{"auto", ImageKind::kAuto}, {"raw", ImageKind::kRaw}, {"rectified", ImageKind::kRectified}},
      c.images);
  section.read("pair_tolerance_s", Range::closed(0.0, 0.5), c.pair_tolerance_s);
  section.finish();
  return c;
}

} // namespace

bool isConfigurationKey(const std::string& name) {
  static const std::set<std::string> keys = {"estimator", "motion",      "buffer",        "invariant",
                                             "inertial",  "calibration", "map",           "paper",
                                             "studies",   kRosSection,   kFrontEndSection};
  return keys.count(name) > 0;
}

FullConfig parseFullConfig(const YAML::Node& document, const std::string& source, const std::string& folder) {
  YamlSection root = YamlSection::root(document, source);
  return {parseConfig(document, source, {kRosSection, kFrontEndSection}, folder),
          readRos(root.section(kRosSection)), readFrontEnd(root.section(kFrontEndSection))};
}

FullConfig parseFullConfig(const std::string& yaml, const std::string& source) {
  return parseFullConfig(parseYaml(yaml, source), source);
}

FullConfig loadFullConfig(const std::string& path) {
  return parseFullConfig(parseYaml(readYamlFile(path), path), path,
                         std::filesystem::path(path).parent_path().string());
}

} // namespace vi_ekf_slam

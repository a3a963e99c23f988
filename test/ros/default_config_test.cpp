#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <fstream>
#include <iomanip>
#include <map>
#include <sstream>
#include <string>

#include "vi_ekf_slam/core/run/calibration_files.hpp"
#include "vi_ekf_slam/core/run/yaml_section.hpp"
#include "vi_ekf_slam/ros/ros_config.hpp"

namespace vi_ekf_slam {
namespace {

const std::string kFolder = std::string(VI_EKF_SLAM_SOURCE_DIR) + "/config/";
const std::string kDefault = kFolder + "default.yaml", kExpert = kFolder + "expert.yaml";
constexpr std::size_t kMostKeys = 40; // of default.yaml, which a user reads as a whole

using Fields = std::map<std::string, std::string>;

template <typename T>
std::string text(const T& value) {
  std::ostringstream out;
  out << std::setprecision(17) << value;
  return out.str();
}
std::string text(const Vector6d& value) { return text(value.transpose()); }
std::string text(const ImuNoise& n) {
  return text(Eigen::RowVector4d(n.gyro_density, n.accelerometer_density, n.gyro_walk, n.accelerometer_walk));
}

/// All that a configuration sets but for the paper's filter, by key.
Fields fieldsOf(const FullConfig& config) {
  Fields f;
  const auto add = [&f](const std::string& key, const auto& value) { f[key] = text(value); };
  const InvariantConfig& c = config.core.invariant;
  add("estimator", static_cast<int>(config.core.estimator));
  add("motion", static_cast<int>(c.choice));
  // The inertial model's velocities are those of the other one: prior_twist_sigma's first, velocity_sigma.
  add("inertial.imu_calibration", c.inertial.noise_file);
  add("inertial.imu_noise", c.inertial.noise);
  add("inertial.imu_bias_sigma",
      Eigen::RowVector2d(c.inertial.gyro_bias_sigma, c.inertial.accelerometer_bias_sigma));
  add("inertial.accelerometer_scale_sigma", c.inertial.accelerometer_scale_sigma);
  add("inertial.gravity", c.inertial.gravity);
  add("invariant.max_tracked", c.max_tracked);
  add("invariant.twist_density", c.motion.twist_density);
  add("invariant.bias_density", c.motion.bias_density);
  add("invariant.prior_twist_sigma", c.motion.prior_twist_sigma);
  add("invariant.prior_bias_sigma", c.motion.prior_bias_sigma);
  add("invariant.velocity_sigma", c.motion.velocity_sigma);
  add("invariant.gyro_sigma", c.motion.gyro_sigma);
  add("invariant.pixel_sigma", c.stereo.pixel_sigma);
  add("invariant.min_disparity", c.stereo.min_disparity);
  add("invariant.max_depth_m", c.stereo.max_depth_m);
  add("invariant.consensus_sigmas", c.update.consensus_sigmas);
  add("invariant.gate", c.update.gate);
  add("invariant.frame_gate", c.update.frame_gate);
  add("invariant.standstill_px", c.standstill_px);
  add("calibration.file", c.rig.known ? c.rig.known->baseline : 0.0);
  add("calibration.rotation_sigma", c.rig.rotation_sigma[0]);
  add("calibration.translation_sigma", c.rig.translation_sigma[0]);
  add("calibration.time_offset", c.rig.time_offset);
  add("calibration.time_offset_sigma", c.rig.time_offset_sigma);
  add("calibration.scale_sigma", c.rig.scale_sigma);
  add("invariant.slip_sigma", c.slip.sigma);
  add("invariant.slip_rotation_sigma", c.slip.rotation_sigma);
  add("invariant.divergence_window_s", c.recovery.monitor.window_s);
  add("map.keep", static_cast<int>(c.map.keep));
  add("map.min_track_s", c.map.min_track_s);
  add("map.max_landmarks", c.map.max_landmarks);
  add("map.recognise_places", static_cast<int>(c.recognise_places));
  add("buffer.max_delay_s", config.core.buffer.max_delay_s);
  add("buffer.max_jump_s", config.core.buffer.max_jump_s);
  add("buffer.max_gap_s", config.core.buffer.max_gap_s);
  add("ros.map_frame", config.ros.map_frame);
  add("ros.odom_frame", config.ros.odom_frame);
  add("ros.imu_frame", config.ros.imu_frame);
  add("ros.base_frame", config.ros.base_frame);
  add("ros.publish_tf", config.ros.publish_tf);
  add("ros.publish_map_tf", config.ros.publish_map_tf);
  add("ros.publish_odom_tf", config.ros.publish_odom_tf);
  add("ros.single_tf", config.ros.single_tf);
  add("ros.transform_tolerance", config.ros.transform_tolerance);
  add("ros.odometry_rate", static_cast<int>(config.ros.odometry_rate));
  add("ros.path_period_s", config.ros.path_period_s);
  add("ros.max_bandwidth_bytes_s", config.ros.max_bandwidth_bytes_s);
  add("ros.landmark_period_s", config.ros.landmark_period_s);
  add("ros.max_features", config.ros.max_features);
  add("ros.max_latency_s", config.ros.max_latency_s);
  add("front_end.features", config.front_end.features);
  add("front_end.images", static_cast<int>(config.front_end.images));
  add("front_end.pair_tolerance_s", config.front_end.pair_tolerance_s);
  add("studies.consensus", c.update.consensus);
  add("studies.unbiased_starts", c.stereo.unbiased_starts);
  add("studies.plausible_gate", c.update.plausible_gate);
  add("studies.motion_gate", c.update.motion_gate);
  add("studies.divergence_jump_m", c.recovery.jump_m);
  return f;
}

/// A calibration of the noise that holds without one: its name is all that it changes.
std::string defaultNoiseFile() {
  const std::string path = testing::TempDir() + "vi_ekf_slam_default_imu.yaml";
  const ImuNoise n;
  std::ofstream(path) << "accelerometer_noise_density: " << text(n.accelerometer_density)
                      << "\naccelerometer_random_walk: " << text(n.accelerometer_walk)
                      << "\ngyroscope_noise_density: " << text(n.gyro_density)
                      << "\ngyroscope_random_walk: " << text(n.gyro_walk) << "\n";
  return path;
}

/// A calibration that changes what the rig is told to be, and nothing else of a configuration.
std::string exampleRigFile() {
  const std::string path = testing::TempDir() + "vi_ekf_slam_default_rig.yaml";
  RigEstimate known;
  known.rig.camera.baseline = 0.5;
  std::ofstream(path) << rigCalibrationText(known);
  return path;
}

/// Each key of the file with another value than its own, which is allowed too, as a document of that key
/// alone.
std::map<std::string, std::string> changesOf(const YAML::Node& file) {
  std::map<std::string, std::string> changes;
  for (const auto& section : file) {
    const std::string name = section.first.Scalar();
    if (!section.second.IsMap()) continue;
    for (const auto& entry : section.second) {
      const YAML::Node& value = entry.second;
      double number = 0.0;
      bool flag = false;
      std::string changed = "other";
      if (value.IsSequence() || YAML::convert<double>::decode(value, number)) {
        changed = text(number == 0.0 ? 0.125 : number / 2.0);
      } else if (YAML::convert<bool>::decode(value, flag)) {
        changed = flag ? "false" : "true";
      } else if (name == "map") {
        changed = entry.first.Scalar() == "keep" ? "all" : "constellation";
      } else if (name == "front_end") {
        changed = "raw";
      } else if (entry.first.Scalar() == "odometry_rate") {
        changed = "frame";
      } else if (entry.first.Scalar() == "imu_calibration") {
        changed = defaultNoiseFile();
      } else if (entry.first.Scalar() == "file") {
        changed = exampleRigFile();
      }
      changes[name + "." + entry.first.Scalar()] = name + ": {" + entry.first.Scalar() + ": " + changed + "}";
    }
  }
  if (file["estimator"]) changes["estimator"] = "estimator: paper";
  if (file["motion"]) changes["motion"] = "motion: inertial";
  return changes;
}

TEST(DefaultConfig, holds_what_a_program_without_a_configuration_does) {
  for (const auto& file : {kDefault, kExpert})
    EXPECT_EQ(fieldsOf(FullConfig()), fieldsOf(loadFullConfig(file))) << file;
}

TEST(DefaultConfig, has_each_key_reach_its_own_field_alone) {
  const Fields defaults = fieldsOf(FullConfig());
  auto changes = changesOf(YAML::LoadFile(kDefault));
  EXPECT_LE(changes.size(), kMostKeys);
  auto others = changesOf(YAML::LoadFile(kExpert));
  changes.merge(others);
  EXPECT_TRUE(others.empty()) << others.begin()->first << " is in both files";
  ASSERT_EQ(defaults.size(), changes.size());
  for (const auto& [key, yaml] : changes) {
    for (const auto& [field, value] : fieldsOf(parseFullConfig(yaml, key))) {
      ASSERT_EQ(1U, defaults.count(field));
      EXPECT_EQ(field == key, value != defaults.at(field)) << yaml << " changes " << field << " to " << value;
    }
  }
}

TEST(DefaultConfig, explains_each_key_beside_it_or_above) {
  std::istringstream lines(readYamlFile(kDefault) + readYamlFile(kExpert));
  std::string line, before;
  while (std::getline(lines, line)) {
    const bool is_key = !line.empty() && line.front() != '#' && line.find(": ") != std::string::npos &&
                        line.find_first_not_of(' ') != line.find('#');
    if (is_key && line.front() == ' ') {
      EXPECT_TRUE(line.find('#') != std::string::npos || before.find('#') != std::string::npos) << line;
    }
    before = line;
  }
}

} // namespace
} // namespace vi_ekf_slam

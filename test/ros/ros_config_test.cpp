#include "vi_ekf_slam/ros/ros_config.hpp"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <array>
#include <cmath>

#include "vi_ekf_slam/ros/node/settings.hpp"

namespace vi_ekf_slam {
namespace {

/// Of a text, or of a document.
template <typename Yaml>
std::string errorOf(const Yaml& yaml) {
  try {
    parseFullConfig(yaml, "file.yaml");
  } catch (const ConfigError& e) {
    return e.what();
  }
  return {};
}

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST(RosConfig, absent_section_means_defaults) {
  const RosConfig c = parseFullConfig("", "file.yaml").ros;
  EXPECT_EQ("map", c.map_frame);
  EXPECT_TRUE(c.publish_tf);
  EXPECT_FALSE(c.single_tf);
}

TEST(RosConfig, one_text_serves_both_halves) {
  const auto c =
      parseFullConfig("{paper: {pixel_noise: 3.5}, ros: {map_frame: world, single_tf: true}}", "file.yaml");
  EXPECT_EQ(3.5, c.core.paper.pixel_noise);
  EXPECT_EQ("world", c.ros.map_frame);
  EXPECT_TRUE(c.ros.single_tf);
}

TEST(RosConfig, names_file_key_and_value_of_what_is_wrong) {
  for (const auto& [yaml, key, value] : std::vector<std::array<std::string, 3>>{
           {"ros: {map_frame: /map}", "map_frame", "/map"},
           {"ros: {odom_frame: map}", "odom_frame", "map"},
           {"ros: {map_frame: ''}", "map_frame", "''"},
           {"ros: {imu_frame: odom}", "imu_frame", "odom"},
           {"ros: {max_features: 0}", "max_features", "0"},
           {"ros: {max_features: 20.5}", "max_features", "20.5"},
           {"ros: {landmark_period_s: -1}", "landmark_period_s", "-1"},
           {"ros: {publish_tf: maybe}", "publish_tf", "maybe"},
           {"ros: {max_latency_s: 61}", "max_latency_s", "61"},
       }) {
    const std::string error = errorOf(yaml);
    EXPECT_TRUE(has(error, "file.yaml") && has(error, key) && has(error, value)) << yaml << " -> " << error;
  }
}

TEST(RosConfig, unknown_keys_are_errors_at_every_level) {
  EXPECT_TRUE(has(errorOf("ros: {map_fram: map}"), "map_fram"));
  EXPECT_TRUE(has(errorOf("rso: {}"), "rso"));
}

/// So that the node reads them all from its parameters, and takes nothing else there for its own.
TEST(RosConfig, knows_the_keys_of_a_configuration) {
  for (const char* name : {"default", "expert", "paper", "dead_reckoning"}) {
    const std::string file = std::string(VI_EKF_SLAM_SOURCE_DIR) + "/config/" + name + ".yaml";
    for (const auto& entry : YAML::LoadFile(file))
      EXPECT_TRUE(isConfigurationKey(entry.first.as<std::string>())) << file;
  }
  for (const std::string key : {"buffer", "invariant", "map", "paper", "studies", "ros"}) {
    EXPECT_TRUE(isConfigurationKey(key));
    EXPECT_EQ("", errorOf(key + ": {}"));
  }
  EXPECT_FALSE(isConfigurationKey("bond_disabled"));
}

/// What the parameter server returns for a YAML file that roslaunch loaded.
TEST(ToYaml, parses_to_the_same_values) {
  XmlRpc::XmlRpcValue tree;
  tree["estimator"] = "paper";
  tree["paper"]["motion_noise"][0] = 1; // YAML 1 is an integer; six numbers may mix
  for (int i = 1; i < 6; ++i) tree["paper"]["motion_noise"][i] = 0.1;
  tree["paper"]["pixel_noise"] = "5e9"; // YAML 1.1 takes 5e9 for a string
  tree["paper"]["prior_landmark_variance"] = 300;
  tree["paper"]["step_s"] = 0.1 + 0.2;
  tree["ros"]["publish_tf"] = false;
  tree["ros"]["map_frame"] = "a \"b\"";
  tree["ros"]["odom_frame"] = "a: #b\n---\n{";
  tree["ros"]["base_frame"] = "";
  tree["map"]["max_landmarks"] = "1000";
  const auto c = parseFullConfig(toYaml(tree), "parameters");
  EXPECT_EQ(1.0, c.core.paper.motion_noise[0]);
  EXPECT_EQ(0.1, c.core.paper.motion_noise[5]);
  EXPECT_EQ(5e9, c.core.paper.pixel_noise);
  EXPECT_EQ(300.0, c.core.paper.prior_landmark_variance);
  EXPECT_EQ(0.1 + 0.2, c.core.paper.step_s); // all digits
  EXPECT_FALSE(c.ros.publish_tf);
  EXPECT_EQ("a \"b\"", c.ros.map_frame);
  EXPECT_EQ("a: #b\n---\n{", c.ros.odom_frame);
  EXPECT_EQ("", c.ros.base_frame);
  EXPECT_EQ(1000U, c.core.invariant.map.max_landmarks);
}

/// As of a file: where, which key, what it is, and what it may be.
TEST(ToYaml, an_error_names_all_that_is_to_be_known) {
  XmlRpc::XmlRpcValue tree;
  tree["invariant"]["gate"] = -1.5;
  EXPECT_EQ(errorOf(toYaml(tree)), errorOf(std::string("invariant: {gate: -1.5}")));
  for (const char* part : {"file.yaml", "invariant.gate", "'-1.5'", "it must be a finite number > 0"})
    EXPECT_TRUE(has(errorOf(toYaml(tree)), part)) << errorOf(toYaml(tree));
  tree["invariant"]["gate"] = 20.0;
  tree["ros"]["map_fram"] = "map";
  EXPECT_TRUE(has(errorOf(toYaml(tree)), "ros.map_fram: unknown key")) << errorOf(toYaml(tree));
  tree["ros"] = 3;
  EXPECT_TRUE(has(errorOf(toYaml(tree)), "ros: '3' is not allowed")) << errorOf(toYaml(tree));
}

TEST(ToYaml, does_not_hide_a_wrong_type) {
  XmlRpc::XmlRpcValue tree;
  tree["ros"]["publish_tf"] = "yes please";
  EXPECT_THROW(parseFullConfig(toYaml(tree), "parameters"), ConfigError);
  tree["ros"]["publish_tf"] = true;
  for (const XmlRpc::XmlRpcValue& wrong : {XmlRpc::XmlRpcValue(true), XmlRpc::XmlRpcValue(std::nan("")),
                                           XmlRpc::XmlRpcValue(HUGE_VAL), XmlRpc::XmlRpcValue("")}) {
    tree["paper"]["pixel_noise"] = wrong;
    EXPECT_THROW(parseFullConfig(toYaml(tree), "parameters"), ConfigError);
  }
}

} // namespace
} // namespace vi_ekf_slam

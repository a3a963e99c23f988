#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "config_errors.hpp"
#include "vi_ekf_slam/core/run/parse_config.hpp"

namespace vi_ekf_slam {
namespace {

const std::string kConfigDir = std::string(VI_EKF_SLAM_SOURCE_DIR) + "/config";

using test::configOf;
using test::errorIn;
using test::errorOf;
using test::expectAll;

TEST(Config, NamesAnUnknownKeyAndTheKnownOnes) {
  expectAll(errorIn("estimatr: paper"),
            {"robot.yaml", "estimatr", "unknown key", "estimator", "buffer", "paper"});
  expectAll(errorIn("paper: {pixel_nose: 1}"),
            {"robot.yaml", "paper.pixel_nose", "unknown key", "pixel_noise"});
  expectAll(errorIn("buffer: {pixel_noise: 1}"),
            {"robot.yaml", "buffer.pixel_noise", "unknown key", "max_delay_s"});
}

// As documentation and messages name it.
TEST(Config, SaysHowAKeyOfASectionIsWritten) {
  for (const std::string text : {"map/keep: none", "map.keep: none"})
    expectAll(errorIn(text),
              {"robot.yaml", "unknown key", "the key keep of the section map", "map: {keep: ...}"});
  expectAll(errorIn("mop/keep: none"), {"mop/keep", "known are buffer"});
}

// What an older file may still ask for: it is not silently ignored.
TEST(Config, NamesAKeyThatIsNoMore) {
  for (const std::string key : {"drift_position", "drift_rotation", "manoeuvre_density", "manoeuvre_share",
                                "twist_state", "scale_significance", "deferred_mb", "consensus",
                                "consensus_px", "motion_gate", "min_depth_m", "divergence_nis"}) {
    expectAll(errorIn("invariant: {" + key + ": 1}"), {"robot.yaml", "invariant." + key, "unknown key"});
  }
  expectAll(errorIn("map: {min_observations: 10}"),
            {"robot.yaml", "map.min_observations", "unknown key", "min_track_s"});
}

TEST(Config, NamesAKeyThatIsGivenTwice) {
  expectAll(errorIn("estimator: paper\nestimator: paper"), {"robot.yaml", "estimator", "twice"});
  expectAll(errorIn("paper:\n  mode: slam\n  mode: mapping"), {"robot.yaml", "paper.mode", "twice"});
}

TEST(Config, NamesTheSourceOfTextThatIsNotYaml) {
  for (const std::string text : {"paper: {mode: slam", "a: b: c", "\t- x", "'open", "{]", "*nowhere"}) {
    expectAll(errorIn(text), {"robot.yaml"});
  }
}

TEST(Config, RefusesAnythingAfterTheFirstDocument) {
  for (const std::string text :
       {"estimator: paper\n---\npaper: {pixel_noise: 2}", "---\n---\npaper: {pixel_noise: 2}",
        "--- {}\n--- {}\n", "estimator: paper\n...\n---\nestimator: paper", "estimator: paper\n---\n[",
        "~\n---\nestimator: paper"}) {
    expectAll(errorIn(text), {"robot.yaml"});
  }
  expectAll(errorIn("estimator: paper\n---\npaper: {pixel_noise: 2}"),
            {"second document", "'---'", "line 2"});
  EXPECT_EQ(configOf("# a comment\n---\npaper: {pixel_noise: 2}\n...\n", "x").paper.pixel_noise, 2.0);
  EXPECT_EQ(configOf("%YAML 1.2\n---\npaper: {pixel_noise: 2}\n", "x").paper.pixel_noise, 2.0);
}

TEST(Config, NamesAKeyThatIsNoName) { expectAll(errorIn("? [1, 2]\n: 3"), {"robot.yaml", "key"}); }

TEST(Config, NamesAFileThatCannotBeRead) {
  expectAll(errorOf([] { readYamlFile("/nowhere/robot.yaml"); }),
            {"/nowhere/robot.yaml", "cannot be opened"});
  expectAll(errorOf([] { readYamlFile(kConfigDir); }), {kConfigDir, "cannot be read"});
}

TEST(Config, NamesTheKeyOfAFileThatCannotBeRead) {
  expectAll(errorIn("calibration: {file: none.yaml}"),
            {"robot.yaml: calibration.file: none.yaml: cannot be opened"});
  expectAll(errorIn("inertial: {imu_calibration: none.yaml}"),
            {"robot.yaml: inertial.imu_calibration: none.yaml: cannot be opened"});
}

TEST(Config, AFileWithoutEndIsNotReadToTheEnd) {
  expectAll(errorOf([] { readYamlFile("/dev/zero"); }), {"/dev/zero", "larger than 1048576 bytes"});
}

TEST(Config, OtherSectionsBelongToSomebodyElse) {
  const std::string yaml = "node: {frames: {world: map}}\npaper: {pixel_noise: 2}";
  EXPECT_EQ(configOf(yaml, "x", {"node"}).paper.pixel_noise, 2.0);
  expectAll(errorIn(yaml), {"robot.yaml", "node", "unknown key"});
  expectAll(errorOf([&] { configOf(yaml, "robot.yaml", {"topics"}); }),
            {"robot.yaml", "node", "unknown key"});
}

/// The top-level keys of a file, for the sections that are not the core's.
std::vector<std::string> topLevelKeys(const std::string& path) {
  std::vector<std::string> keys;
  for (const auto& entry : YAML::LoadFile(path)) keys.push_back(entry.first.Scalar());
  return keys;
}

Config load(const std::string& path) { return configOf(readYamlFile(path), path, topLevelKeys(path)); }

TEST(Config, EveryShippedEstimatorFileParses) {
  std::size_t read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kConfigDir)) {
    const std::string path = entry.path().string();
    if (entry.path().extension() != ".yaml" || !YAML::LoadFile(path)["estimator"]) continue;
    EXPECT_EQ(errorOf([&] { load(path); }), "") << path;
    ++read;
  }
  EXPECT_GE(read, 2U);
}

TEST(Config, PaperFileHoldsTheValuesOfThePaper) {
  const std::string path = kConfigDir + "/paper.yaml";
  const Config config = load(path);
  EXPECT_EQ(config.estimator, EstimatorType::kPaper);
  EXPECT_EQ(config.paper.mode, PaperMode::kSlam);
  EXPECT_EQ(config.paper.motion_noise, Vector6d::Constant(1e-4)); // W
  EXPECT_EQ(config.paper.pixel_noise, 5e9);                       // V
  EXPECT_EQ(config.paper.prior_pose_variance, 0.01);              // Sigma_IMU
  EXPECT_EQ(config.paper.prior_landmark_variance, 300.0);         // Sigma_Landmark
  EXPECT_EQ(config.paper.landmark_fraction, 0.1);                 // section IV-B
}

TEST(Config, DeadReckoningFileAsksForDeadReckoning) {
  const std::string path = kConfigDir + "/dead_reckoning.yaml";
  EXPECT_EQ(load(path).paper.mode, PaperMode::kDeadReckoning);
}

TEST(Config, ALongFileIsRefusedByItsFirstUnknownKey) {
  std::string yaml;
  for (int i = 0; i < 20000; ++i) yaml += "key_" + std::to_string(i) + ": value\n";
  expectAll(errorIn(yaml), {"robot.yaml", "unknown key"});
}

TEST(Config, ALongValueIsCutInTheMessage) {
  const std::string message = errorIn("paper: {pixel_noise: " + std::string(900, 'x') + "}");
  expectAll(message, {"robot.yaml", "paper.pixel_noise", "..."});
  EXPECT_LT(message.size(), 500U);
}

TEST(Config, DeepNestingIsAnErrorAndNoCrash) {
  const int depth = 100000;
  std::string blocks, pairs, lines;
  for (int i = 0; i < depth; ++i) lines += "[\n";
  for (int i = 0; i < 2000; ++i) blocks += std::string(static_cast<std::size_t>(i), ' ') + "a:\n";
  for (int i = 0; i < depth; ++i) pairs += "{a: ";
  std::string dashes;
  for (int i = 0; i < depth; ++i) dashes += "- ";
  for (const std::string& yaml : {"paper: " + std::string(depth, '['), "paper: " + pairs, dashes + "1",
                                  blocks, "paper: " + std::string(depth, '[') + std::string(depth, ']')}) {
    expectAll(errorIn(yaml), {"robot.yaml"});
  }
}

TEST(Config, ALongCommentAndAFewBracketsAreNoDeepNesting) {
  const std::string yaml = "# " + std::string(900, '[') + "\npaper: {motion_noise: [1, 1, 1, 1, 1, 1]}";
  EXPECT_EQ(configOf(yaml, "x").paper.motion_noise, Vector6d::Ones());
}

TEST(Config, AliasesThatContainThemselvesAreAnErrorAndNoCrash) {
  expectAll(errorIn("paper: &p {mode: *p}"), {"robot.yaml"});
  expectAll(errorIn("paper: &p\n  motion_noise: *p"), {"robot.yaml"});
}

// The node writes all its parameters on one line.
TEST(Config, AcceptsALongLine) {
  std::string list = "0.5";
  for (int i = 0; i < 5; ++i) list += ", 0.50000000000000000";
  std::string yaml = "{estimator: invariant, invariant: {twist_density: [" + list + "]}, ros: {note: '";
  yaml += std::string(5000, 'x') + "'}}";
  EXPECT_EQ(configOf(yaml, "x", {"ros"}).invariant.motion.twist_density, Vector6d::Constant(0.5));
}

} // namespace
} // namespace vi_ekf_slam

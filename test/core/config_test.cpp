#include "vi_ekf_slam/core/run/config.hpp"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <limits>
#include <ostream>
#include <string>
#include <vector>

#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam {
namespace {

const std::string kConfigDir = std::string(VI_EKF_SLAM_SOURCE_DIR) + "/config";

/// what() of the ConfigError that `f` throws; empty when it throws none.
template <typename F>
std::string errorOf(const F& f) {
  try {
    f();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

std::string errorIn(const std::string& yaml) {
  return errorOf([&] { parseConfig(yaml, "robot.yaml"); });
}

void expectAll(const std::string& message, const std::vector<std::string>& parts) {
  for (const auto& part : parts) {
    EXPECT_NE(message.find(part), std::string::npos) << "'" << part << "' is missing in: " << message;
  }
}

struct BadValue {
  std::string yaml;
  std::string key;
  std::string value;
  std::string allowed;
};

void PrintTo(const BadValue& bad, std::ostream* out) { *out << bad.yaml; }

class Refused : public ::testing::TestWithParam<BadValue> {};

TEST_P(Refused, WithSourceKeyValueAndWhatIsAllowed) {
  const BadValue& bad = GetParam();
  const std::string message = errorIn(bad.yaml);
  ASSERT_FALSE(message.empty()) << "accepted: " << bad.yaml;
  expectAll(message, {"robot.yaml", bad.key, "'" + bad.value + "'", bad.allowed});
}

INSTANTIATE_TEST_SUITE_P(
    Values, Refused,
    ::testing::Values(
        BadValue{"estimator: kalman", "estimator", "kalman", "one of invariant, paper"},
        BadValue{"estimator: ~", "estimator", "~", "one of invariant, paper"},
        BadValue{"buffer: {max_delay_s: 0}", "buffer.max_delay_s", "0", "> 0 and <= 60"},
        BadValue{"buffer: {max_delay_s: 61}", "buffer.max_delay_s", "61", "> 0 and <= 60"},
        BadValue{"buffer: {max_delay_s: fast}", "buffer.max_delay_s", "fast", "a finite number"},
        BadValue{"buffer: {max_delay_s: .nan}", "buffer.max_delay_s", ".nan", "a finite number"},
        BadValue{"buffer: {max_jump_back_s: -1}", "buffer.max_jump_back_s", "-1", "> 0"},
        BadValue{"buffer: {max_size: 1.5}", "buffer.max_size", "1.5", "a whole number"},
        BadValue{"buffer: {max_size: 0}", "buffer.max_size", "0", ">= 1"},
        BadValue{"buffer: {rig_wait_s: -0.1}", "buffer.rig_wait_s", "-0.1", ">= 0"},
        BadValue{"buffer: 3", "robot.yaml: buffer:", "3", "a mapping"},
        BadValue{"paper: [1, 2]", "paper", "[1, 2]", "a mapping"},
        BadValue{"paper: {mode: fast}", "paper.mode", "fast", "one of dead_reckoning, mapping, slam"},
        BadValue{"paper: {mode: [slam]}", "paper.mode", "[slam]", "one of dead_reckoning, mapping, slam"},
        BadValue{"paper: {pixel_noise: 0}", "paper.pixel_noise", "0", "> 0"},
        BadValue{"paper: {pixel_noise: .inf}", "paper.pixel_noise", ".inf", "a finite number > 0"},
        BadValue{"paper: {pixel_noise: 1e999}", "paper.pixel_noise", "1e999", "a finite number > 0"},
        BadValue{"paper: {pixel_noise: 5 px}", "paper.pixel_noise", "5 px", "a finite number > 0"},
        BadValue{"paper: {pixel_noise: }", "paper.pixel_noise", "~", "a finite number > 0"},
        BadValue{"paper: {motion_noise: -1}", "paper.motion_noise", "-1", ">= 0"},
        BadValue{"paper: {motion_noise: [1, 2]}", "paper.motion_noise", "[1, 2]",
                 "one number or a list of 6"},
        BadValue{"paper: {motion_noise: [1, 1, 1, x, 1, 1]}", "paper.motion_noise[3]", "x", ">= 0"},
        BadValue{"paper: {motion_noise: {a: 1}}", "paper.motion_noise", "{a: 1}",
                 "one number or a list of 6"},
        BadValue{"paper: {landmark_fraction: 0}", "paper.landmark_fraction", "0", "> 0 and <= 1"},
        BadValue{"paper: {landmark_fraction: 1.01}", "paper.landmark_fraction", "1.01", "> 0 and <= 1"},
        BadValue{"paper: {prior_pose_variance: -1}", "paper.prior_pose_variance", "-1", ">= 0"},
        BadValue{"paper: {prior_landmark_variance: 0}", "paper.prior_landmark_variance", "0", "> 0"},
        BadValue{"paper: {step_s: 0}", "paper.step_s", "0", "> 0"},
        BadValue{"paper: {min_depth_m: 0}", "paper.min_depth_m", "0", "> 0"},
        BadValue{"paper: {min_depth_m: 5, max_depth_m: 5}", "paper.max_depth_m", "5",
                 "greater than min_depth_m"},
        BadValue{"paper: {min_depth_m: 5, max_depth_m: 2.5e-9}", "paper.max_depth_m", "2.5e-9",
                 "greater than min_depth_m"},
        BadValue{"invariant: {twist_density: -1}", "invariant.twist_density", "-1", ">= 0"},
        BadValue{"invariant: {prior_twist_sigma: 0}", "invariant.prior_twist_sigma", "0", "> 0"},
        BadValue{"invariant: {pixel_sigma: 0}", "invariant.pixel_sigma", "0", "> 0"},
        BadValue{"invariant: {min_depth_m: 5, max_depth_m: 4}", "invariant.max_depth_m", "4",
                 "greater than min_depth_m"},
        BadValue{"invariant: {consensus: 2}", "invariant.consensus", "2", "true or false"},
        BadValue{"invariant: {gate: .nan}", "invariant.gate", ".nan", "a finite number > 0"},
        BadValue{"invariant: {divergence_window_s: -1}", "invariant.divergence_window_s", "-1", ">= 0"},
        BadValue{"invariant: {divergence_share: 1.1}", "invariant.divergence_share", "1.1", "> 0 and <= 1"},
        BadValue{"invariant: {standstill_px: -0.1}", "invariant.standstill_px", "-0.1", ">= 0"},
        BadValue{"invariant: {scale_sigma: 0.3}", "invariant.scale_sigma", "0.3", "<= 0.2"},
        BadValue{"map: {keep: some}", "map.keep", "some", "one of none, good, all"},
        BadValue{"map: {min_track_s: -1}", "map.min_track_s", "-1", ">= 0"},
        BadValue{"map: {max_landmarks: 20001}", "map.max_landmarks", "20001", "<= 20000"},
        BadValue{"map: {max_landmarks: 1.5}", "map.max_landmarks", "1.5", "a whole number"},
        BadValue{"- 1\n- 2", "the document", "- 1\n- 2", "a mapping"}));

TEST(Config, NamesAnUnknownKeyAndTheKnownOnes) {
  expectAll(errorIn("estimatr: paper"),
            {"robot.yaml", "estimatr", "unknown key", "estimator", "buffer", "paper"});
  expectAll(errorIn("paper: {pixel_nose: 1}"),
            {"robot.yaml", "paper.pixel_nose", "unknown key", "pixel_noise"});
  expectAll(errorIn("buffer: {pixel_noise: 1}"),
            {"robot.yaml", "buffer.pixel_noise", "unknown key", "max_delay_s"});
}

// What an older file may still ask for: it is not silently ignored.
TEST(Config, NamesAKeyThatIsNoMore) {
  for (const std::string key : {"drift_position", "drift_rotation", "manoeuvre_density", "manoeuvre_share",
                                "twist_state", "scale_significance", "deferred_mb"}) {
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
  EXPECT_EQ(parseConfig("# a comment\n---\npaper: {pixel_noise: 2}\n...\n", "x").paper.pixel_noise, 2.0);
  EXPECT_EQ(parseConfig("%YAML 1.2\n---\npaper: {pixel_noise: 2}\n", "x").paper.pixel_noise, 2.0);
}

TEST(Config, NamesAKeyThatIsNoName) { expectAll(errorIn("? [1, 2]\n: 3"), {"robot.yaml", "key"}); }

TEST(Config, NamesAFileThatCannotBeRead) {
  expectAll(errorOf([] { loadConfig("/nowhere/robot.yaml"); }), {"/nowhere/robot.yaml", "cannot be opened"});
  expectAll(errorOf([] { loadConfig(kConfigDir); }), {kConfigDir, "cannot be read"});
}

TEST(Config, AFileWithoutEndIsNotReadToTheEnd) {
  expectAll(errorOf([] { loadConfig("/dev/zero"); }), {"/dev/zero", "larger than 1048576 bytes"});
}

TEST(Config, NothingAtAllMeansTheDefaults) {
  for (const std::string text : {"", "\n", "# a comment", "---", "~", "paper:", "paper: {}", "buffer: ~"}) {
    const Config config = parseConfig(text, "robot.yaml");
    EXPECT_EQ(config.estimator, Config().estimator) << text;
    EXPECT_EQ(config.paper.pixel_noise, 5e9) << text;
    EXPECT_EQ(config.buffer.max_delay_s, MeasurementBuffer::Options().max_delay_s) << text;
  }
}

TEST(Config, EveryKeyReachesItsField) {
  const Config config = parseConfig(R"(
estimator: paper
buffer: {max_delay_s: 0.3, max_jump_back_s: 4, max_size: 77, rig_wait_s: 9}
paper:
  mode: mapping
  motion_noise: [1, 2, 3, 4, 5, 6]
  step_s: 0.25
  pixel_noise: 7
  prior_pose_variance: 8
  prior_landmark_variance: 10
  landmark_fraction: 0.5
  min_depth_m: 0.75
  max_depth_m: 99
)",
                                    "robot.yaml");
  EXPECT_EQ(config.estimator, EstimatorType::kPaper);
  EXPECT_EQ(config.buffer.max_delay_s, 0.3);
  EXPECT_EQ(config.buffer.max_jump_back_s, 4.0);
  EXPECT_EQ(config.buffer.max_size, 77U);
  EXPECT_EQ(config.rig_wait_s, 9.0);
  EXPECT_EQ(config.paper.mode, PaperMode::kMapping);
  Vector6d W;
  W << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0;
  EXPECT_EQ(config.paper.motion_noise, W);
  EXPECT_EQ(config.paper.step_s, 0.25);
  EXPECT_EQ(config.paper.pixel_noise, 7.0);
  EXPECT_EQ(config.paper.prior_pose_variance, 8.0);
  EXPECT_EQ(config.paper.prior_landmark_variance, 10.0);
  EXPECT_EQ(config.paper.landmark_fraction, 0.5);
  EXPECT_EQ(config.paper.min_depth_m, 0.75);
  EXPECT_EQ(config.paper.max_depth_m, 99.0);
}

TEST(Config, EveryKeyOfTheInvariantFilterReachesItsField) {
  const InvariantConfig c = parseConfig(R"(
invariant:
  twist_density: [1, 2, 3, 4, 5, 6]
  bias_density: 0.1
  prior_twist_sigma: 0.2
  prior_bias_sigma: 0.3
  velocity_sigma: 0.4
  gyro_sigma: 0.5
  pixel_sigma: 0.6
  min_disparity: 0.7
  max_row_offset: 0.8
  min_depth_m: 0.9
  max_depth_m: 10
  consensus: false
  consensus_px: 11
  gate: 12
  frame_gate: 13
  plausible_gate: 14
  motion_gate: 15
  divergence_window_s: 16
  divergence_nis: 17
  divergence_share: 0.18
  divergence_jump_m: 19
  standstill_px: 20
  scale_sigma: 0.121
map: {keep: all, min_track_s: 22, max_landmarks: 23, recognise_places: true}
)",
                                        "robot.yaml")
                                .invariant;
  EXPECT_EQ(c.motion.twist_density, (Vector6d() << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0).finished());
  EXPECT_EQ(c.motion.bias_density, Vector6d::Constant(0.1));
  EXPECT_EQ(c.motion.prior_twist_sigma, Vector6d::Constant(0.2));
  EXPECT_EQ(c.motion.prior_bias_sigma, Vector6d::Constant(0.3));
  EXPECT_EQ(c.motion.velocity_sigma, 0.4);
  EXPECT_EQ(c.motion.gyro_sigma, 0.5);
  EXPECT_EQ(c.stereo.pixel_sigma, 0.6);
  EXPECT_EQ(c.stereo.min_disparity, 0.7);
  EXPECT_EQ(c.stereo.max_row_offset, 0.8);
  EXPECT_EQ(c.stereo.min_depth_m, 0.9);
  EXPECT_EQ(c.stereo.max_depth_m, 10.0);
  EXPECT_FALSE(c.update.consensus);
  EXPECT_EQ(c.update.consensus_px, 11.0);
  EXPECT_EQ(c.update.gate, 12.0);
  EXPECT_EQ(c.update.frame_gate, 13.0);
  EXPECT_EQ(c.update.plausible_gate, 14.0);
  EXPECT_EQ(c.update.motion_gate, 15.0);
  EXPECT_EQ(c.recovery.monitor.window_s, 16.0);
  EXPECT_EQ(c.recovery.monitor.nis, 17.0);
  EXPECT_EQ(c.recovery.monitor.refused_share, 0.18);
  EXPECT_EQ(c.recovery.jump_m, 19.0);
  EXPECT_EQ(c.standstill_px, 20.0);
  EXPECT_EQ(c.scale_sigma, 0.121);
  EXPECT_EQ(c.map.keep, MapKeep::kAll);
  EXPECT_EQ(c.map.min_track_s, 22.0);
  EXPECT_EQ(c.map.max_landmarks, 23U);
  EXPECT_TRUE(c.recognise_places);
}

TEST(Config, NumbersMayBeWrittenAsPythonWritesThem) {
  // YAML 1.1 readers take 5e9 for text; PyYAML writes it so.
  EXPECT_EQ(parseConfig("paper: {pixel_noise: 5e9}", "x").paper.pixel_noise, 5e9);
  EXPECT_EQ(parseConfig("paper: {pixel_noise: '5e9'}", "x").paper.pixel_noise, 5e9);
  EXPECT_EQ(parseConfig("paper: {pixel_noise: 5.0e+09}", "x").paper.pixel_noise, 5e9);
  EXPECT_EQ(parseConfig("paper: {motion_noise: 1e-4}", "x").paper.motion_noise, Vector6d::Constant(1e-4));
  EXPECT_EQ(parseConfig("buffer: {max_size: 1e3}", "x").buffer.max_size, 1000U);
}

TEST(Config, OtherSectionsBelongToSomebodyElse) {
  const std::string yaml = "node: {frames: {world: map}}\npaper: {pixel_noise: 2}";
  EXPECT_EQ(parseConfig(yaml, "x", {"node"}).paper.pixel_noise, 2.0);
  expectAll(errorIn(yaml), {"robot.yaml", "node", "unknown key"});
  expectAll(errorOf([&] { parseConfig(yaml, "robot.yaml", {"topics"}); }),
            {"robot.yaml", "node", "unknown key"});
}

/// The top-level keys of a file, for the sections that are not the core's.
std::vector<std::string> topLevelKeys(const std::string& path) {
  std::vector<std::string> keys;
  for (const auto& entry : YAML::LoadFile(path)) keys.push_back(entry.first.Scalar());
  return keys;
}

TEST(Config, EveryShippedEstimatorFileParses) {
  std::size_t read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kConfigDir)) {
    const std::string path = entry.path().string();
    if (entry.path().extension() != ".yaml" || !YAML::LoadFile(path)["estimator"]) continue;
    EXPECT_EQ(errorOf([&] { loadConfig(path, topLevelKeys(path)); }), "") << path;
    ++read;
  }
  EXPECT_GE(read, 2U);
}

TEST(Config, PaperFileHoldsTheValuesOfThePaper) {
  const std::string path = kConfigDir + "/paper.yaml";
  const Config config = loadConfig(path, topLevelKeys(path));
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
  EXPECT_EQ(loadConfig(path, topLevelKeys(path)).paper.mode, PaperMode::kDeadReckoning);
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
  EXPECT_EQ(parseConfig(yaml, "x").paper.motion_noise, Vector6d::Ones());
}

TEST(Config, AliasesThatContainThemselvesAreAnErrorAndNoCrash) {
  expectAll(errorIn("paper: &p {mode: *p}"), {"robot.yaml"});
  expectAll(errorIn("paper: &p\n  motion_noise: *p"), {"robot.yaml"});
}

TEST(YamlSection, ReadsTruthTextAndWholeNumbers) {
  YamlSection root = YamlSection::root("{flag: true, name: 'a b', count: 12}", "x");
  bool flag = false;
  std::string name;
  std::size_t count = 0;
  root.read("flag", flag);
  root.read("name", name);
  root.read("count", Range::closed(0.0, 20.0), count);
  EXPECT_TRUE(flag);
  EXPECT_EQ(name, "a b");
  EXPECT_EQ(count, 12U);
  EXPECT_NO_THROW(root.finish());
}

TEST(YamlSection, RefusesTruthAndTextOfAnotherKind) {
  YamlSection root = YamlSection::root("{flag: perhaps, name: [a]}", "x.yaml");
  bool flag = false;
  std::string name;
  expectAll(errorOf([&] { root.read("flag", flag); }), {"x.yaml", "flag", "'perhaps'", "true or false"});
  expectAll(errorOf([&] { root.read("name", name); }), {"x.yaml", "name", "'[a]'", "a text"});
}

TEST(YamlSection, AnAbsentKeyKeepsTheDefaultAndIsKnownToFinish) {
  YamlSection root = YamlSection::root("{}", "x");
  double value = 4.0;
  bool flag = true;
  std::string name = "kept";
  Eigen::VectorXd vector = Eigen::VectorXd::Constant(3, 2.0);
  root.read("value", Range::positive(), value);
  root.read("flag", flag);
  root.read("name", name);
  root.read("vector", Range::positive(), vector);
  EXPECT_EQ(value, 4.0);
  EXPECT_TRUE(flag);
  EXPECT_EQ(name, "kept");
  EXPECT_EQ(vector, Eigen::VectorXd::Constant(3, 2.0));
  EXPECT_NO_THROW(root.finish());
}

TEST(YamlSection, FinishNamesWhatNobodyAskedFor) {
  YamlSection root = YamlSection::root("{a: 1, b: 2}", "x.yaml");
  double a = 0.0;
  root.read("a", Range::positive(), a);
  expectAll(errorOf([&] { root.finish(); }), {"x.yaml", "b", "unknown key", "a"});
  root.allow("b");
  EXPECT_NO_THROW(root.finish());
}

TEST(Range, ContainsItsClosedEndsAndNotItsOpenOnes) {
  EXPECT_TRUE(Range::closed(1.0, 2.0).contains(1.0));
  EXPECT_TRUE(Range::closed(1.0, 2.0).contains(2.0));
  EXPECT_FALSE(Range::closed(1.0, 2.0).contains(2.0001));
  EXPECT_FALSE(Range::halfOpen(1.0, 2.0).contains(1.0));
  EXPECT_TRUE(Range::halfOpen(1.0, 2.0).contains(2.0));
  EXPECT_FALSE(Range::positive().contains(0.0));
  EXPECT_TRUE(Range::notNegative().contains(0.0));
  EXPECT_FALSE(Range::notNegative().contains(-1e-300));
  EXPECT_FALSE(Range::notNegative().contains(std::numeric_limits<double>::infinity()));
  EXPECT_FALSE(Range::notNegative().contains(std::numeric_limits<double>::quiet_NaN()));
}

} // namespace
// The node writes all its parameters on one line.
TEST(Config, AcceptsALongLine) {
  std::string list = "0.5";
  for (int i = 0; i < 5; ++i) list += ", 0.50000000000000000";
  std::string yaml = "{estimator: invariant, invariant: {twist_density: [" + list + "]}, ros: {note: '";
  yaml += std::string(5000, 'x') + "'}}";
  EXPECT_EQ(parseConfig(yaml, "x", {"ros"}).invariant.motion.twist_density, Vector6d::Constant(0.5));
}

} // namespace vi_ekf_slam

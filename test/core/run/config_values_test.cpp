#include <gtest/gtest.h>

#include <ostream>
#include <string>

#include "config_errors.hpp"

namespace vi_ekf_slam {
namespace {

using test::configOf;
using test::errorIn;
using test::expectAll;

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
        BadValue{"buffer: {max_jump_s: -1}", "buffer.max_jump_s", "-1", "> 0"},
        BadValue{"buffer: {max_gap_s: 0}", "buffer.max_gap_s", "0", "> 0 and <= 1e+06"},
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
        BadValue{"invariant: {max_depth_m: 0.5}", "invariant.max_depth_m", "0.5", "> 0.5"},
        BadValue{"invariant: {gate: .nan}", "invariant.gate", ".nan", "a finite number > 0"},
        BadValue{"invariant: {divergence_window_s: -1}", "invariant.divergence_window_s", "-1", ">= 0"},
        BadValue{"invariant: {standstill_px: -0.1}", "invariant.standstill_px", "-0.1", ">= 0"},
        BadValue{"calibration: {scale_sigma: 0.3}", "calibration.scale_sigma", "0.3", "<= 0.2"},
        BadValue{"calibration: {time_offset: 2}", "calibration.time_offset", "2", "<= 1"},
        BadValue{"calibration: {rotation_sigma: -0.1}", "calibration.rotation_sigma", "-0.1", ">= 0"},
        BadValue{"studies: {consensus: 2}", "studies.consensus", "2", "true or false"},
        BadValue{"studies: {divergence_jump_m: -1}", "studies.divergence_jump_m", "-1", ">= 0"},
        BadValue{"map: {keep: some}", "map.keep", "some", "one of none, good, all"},
        BadValue{"map: {min_track_s: -1}", "map.min_track_s", "-1", ">= 0"},
        BadValue{"map: {max_landmarks: 20001}", "map.max_landmarks", "20001", "<= 20000"},
        BadValue{"map: {max_landmarks: 1.5}", "map.max_landmarks", "1.5", "a whole number"},
        BadValue{"- 1\n- 2", "the document", "- 1\n- 2", "a mapping"}));

TEST(Config, NothingAtAllMeansTheDefaults) {
  for (const std::string text : {"", "\n", "# a comment", "---", "~", "paper:", "paper: {}", "buffer: ~"}) {
    const Config config = configOf(text, "robot.yaml");
    EXPECT_EQ(config.estimator, Config().estimator) << text;
    EXPECT_EQ(config.paper.pixel_noise, 5e9) << text;
    EXPECT_EQ(config.buffer.max_delay_s, MeasurementBuffer::Options().max_delay_s) << text;
  }
}

TEST(Config, EveryKeyReachesItsField) {
  const Config config = configOf(R"(
estimator: paper
buffer: {max_delay_s: 0.3, max_jump_s: 4}
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
  EXPECT_EQ(config.buffer.max_jump_s, 4.0);
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

TEST(Config, StudiesMaySwitchOffWhatNoVehicleAsksFor) {
  const InvariantConfig c =
      configOf("studies: {consensus: false, plausible_gate: 14, motion_gate: 15, divergence_jump_m: 0}", "x")
          .invariant;
  EXPECT_FALSE(c.update.consensus);
  EXPECT_EQ(c.update.plausible_gate, 14.0);
  EXPECT_EQ(c.update.motion_gate, 15.0);
  EXPECT_EQ(c.recovery.jump_m, 0.0);
}

TEST(Config, NumbersMayBeWrittenAsPythonWritesThem) {
  // YAML 1.1 readers take 5e9 for text; PyYAML writes it so.
  EXPECT_EQ(configOf("paper: {pixel_noise: 5e9}", "x").paper.pixel_noise, 5e9);
  EXPECT_EQ(configOf("paper: {pixel_noise: '5e9'}", "x").paper.pixel_noise, 5e9);
  EXPECT_EQ(configOf("paper: {pixel_noise: 5.0e+09}", "x").paper.pixel_noise, 5e9);
  EXPECT_EQ(configOf("paper: {motion_noise: 1e-4}", "x").paper.motion_noise, Vector6d::Constant(1e-4));
  EXPECT_EQ(configOf("map: {max_landmarks: 1e3}", "x").invariant.map.max_landmarks, 1000U);
}

} // namespace
} // namespace vi_ekf_slam

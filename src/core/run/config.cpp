#include "vi_ekf_slam/core/run/config.hpp"

#include <sstream>

#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam {
namespace {

void readBuffer(YamlSection section, MeasurementBuffer::Options& buffer, double& rig_wait_s) {
  section.read("max_delay_s", Range::halfOpen(0.0, 60.0), buffer.max_delay_s);
  section.read("max_jump_back_s", Range::halfOpen(0.0, 3600.0), buffer.max_jump_back_s);
  section.read("max_jump_ahead_s", Range::halfOpen(0.0, 3600.0), buffer.max_jump_ahead_s);
  section.read("max_gap_s", Range::halfOpen(0.0, 1e6), buffer.max_gap_s);
  section.read("jump_confirmations", Range::closed(1.0, 1000.0), buffer.jump_confirmations);
  section.read("max_size", Range::closed(1.0, 1e9), buffer.max_size);
  section.read("rig_wait_s", Range::closed(0.0, 3600.0), rig_wait_s);
  section.finish();
}

void checkDepths(const YamlSection& section, double min_depth_m, double max_depth_m) {
  if (max_depth_m > min_depth_m) return;
  std::ostringstream value;
  value << max_depth_m;
  section.fail("max_depth_m", value.str(), "greater than min_depth_m");
}

void readPaper(YamlSection section, PaperConfig& paper) {
  section.readChoice<PaperMode>("mode",
                                {{"dead_reckoning", PaperMode::kDeadReckoning},
                                 {"mapping", PaperMode::kMapping},
                                 {"slam", PaperMode::kSlam}},
                                paper.mode);
  section.read("motion_noise", Range::notNegative(), paper.motion_noise);
  section.read("step_s", Range::positive(), paper.step_s);
  section.read("pixel_noise", Range::positive(), paper.pixel_noise);
  section.read("prior_pose_variance", Range::notNegative(), paper.prior_pose_variance);
  section.read("prior_landmark_variance", Range::positive(), paper.prior_landmark_variance);
  section.read("landmark_fraction", Range::halfOpen(0.0, 1.0), paper.landmark_fraction);
  section.read("min_depth_m", Range::positive(), paper.min_depth_m);
  section.read("max_depth_m", Range::positive(), paper.max_depth_m);
  checkDepths(section, paper.min_depth_m, paper.max_depth_m);
  section.finish();
}

void readInvariant(YamlSection section, InvariantConfig& invariant) {
  section.read("twist_density", Range::notNegative(), invariant.twist_density);
  section.read("bias_density", Range::notNegative(), invariant.bias_density);
  section.read("prior_twist_sigma", Range::positive(), invariant.prior_twist_sigma);
  section.read("prior_bias_sigma", Range::positive(), invariant.prior_bias_sigma);
  section.read("velocity_sigma", Range::positive(), invariant.velocity_sigma);
  section.read("gyro_sigma", Range::positive(), invariant.gyro_sigma);
  section.read("twist_state", invariant.twist_state);
  section.read("pixel_sigma", Range::positive(), invariant.pixel_sigma);
  section.read("min_disparity", Range::positive(), invariant.min_disparity);
  section.read("max_row_offset", Range::positive(), invariant.max_row_offset);
  section.read("min_depth_m", Range::positive(), invariant.min_depth_m);
  section.read("max_depth_m", Range::positive(), invariant.max_depth_m);
  section.read("consensus", invariant.consensus);
  section.read("consensus_px", Range::positive(), invariant.consensus_px);
  section.read("gate", Range::positive(), invariant.gate);
  section.read("frame_gate", Range::positive(), invariant.frame_gate);
  section.read("plausible_gate", Range::positive(), invariant.plausible_gate);
  section.read("motion_gate", Range::positive(), invariant.motion_gate);
  section.read("manoeuvre_density", Range::notNegative(), invariant.manoeuvre_density);
  section.read("manoeuvre_share", Range::closed(0.5, 1.0), invariant.manoeuvre_share);
  section.read("drift_position", Range::notNegative(), invariant.drift_position);
  section.read("drift_rotation", Range::notNegative(), invariant.drift_rotation);
  section.read("standstill_px", Range::notNegative(), invariant.standstill_px);
  section.read("scale_sigma", Range::closed(0.0, 0.2), invariant.scale_sigma);
  section.read("scale_significance", Range::positive(), invariant.scale_significance);
  section.read("divergence_window_s", Range::closed(0.0, 3600.0), invariant.divergence.window_s);
  section.read("divergence_nis", Range::positive(), invariant.divergence.nis);
  section.read("divergence_share", Range::halfOpen(0.0, 1.0), invariant.divergence.refused_share);
  section.read("divergence_jump_m", Range::closed(0.0, 1e6), invariant.divergence_jump_m);
  checkDepths(section, invariant.min_depth_m, invariant.max_depth_m);
  section.finish();
}

void readMap(YamlSection section, MapConfig& map) {
  section.readChoice<MapKeep>(
      "keep", {{"none", MapKeep::kNone}, {"good", MapKeep::kGood}, {"all", MapKeep::kAll}}, map.keep);
  section.read("min_observations", Range::closed(1.0, 1e6), map.min_observations);
  section.read("max_landmarks", Range::closed(0.0, 20000.0), map.max_landmarks);
  section.read("deferred_mb", Range::closed(16.0, 1e6), map.deferred_mb);
  section.read("recognise_places", map.recognise_places);
  section.finish();
}

} // namespace

Config parseConfig(const std::string& yaml, const std::string& source,
                   const std::vector<std::string>& other_sections) {
  Config config;
  YamlSection root = YamlSection::root(yaml, source);
  root.readChoice<EstimatorType>("estimator",
                                 {{"invariant", EstimatorType::kInvariant}, {"paper", EstimatorType::kPaper}},
                                 config.estimator);
  readBuffer(root.section("buffer"), config.buffer, config.rig_wait_s);
  readInvariant(root.section("invariant"), config.invariant);
  readMap(root.section("map"), config.invariant.map);
  readPaper(root.section("paper"), config.paper);
  for (const auto& section : other_sections) root.allow(section);
  root.finish();
  return config;
}

Config loadConfig(const std::string& path, const std::vector<std::string>& other_sections) {
  return parseConfig(readYamlFile(path), path, other_sections);
}

} // namespace vi_ekf_slam

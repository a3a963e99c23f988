#include "vi_ekf_slam/core/run/parse_config.hpp"

#include <filesystem>

#include "vi_ekf_slam/core/run/calibration_files.hpp"
#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam {
namespace {

void readBuffer(YamlSection section, MeasurementBuffer::Options& buffer) {
  section.read("max_delay_s", Range::halfOpen(0.0, 60.0), buffer.max_delay_s);
  section.read("max_jump_s", Range::halfOpen(0.0, 3600.0), buffer.max_jump_s);
  section.read("max_gap_s", Range::halfOpen(0.0, 1e6), buffer.max_gap_s);
  section.finish();
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
  if (!(paper.max_depth_m > paper.min_depth_m))
    section.fail("max_depth_m", std::to_string(paper.max_depth_m), "greater than min_depth_m");
  section.finish();
}

void readInvariant(YamlSection section, InvariantConfig& invariant) {
  ConstantTwist::Options& motion = invariant.motion;
  section.read("twist_density", Range::notNegative(), motion.twist_density);
  section.read("bias_density", Range::notNegative(), motion.bias_density);
  section.read("prior_twist_sigma", Range::positive(), motion.prior_twist_sigma);
  section.read("prior_bias_sigma", Range::positive(), motion.prior_bias_sigma);
  section.read("velocity_sigma", Range::positive(), motion.velocity_sigma);
  section.read("gyro_sigma", Range::positive(), motion.gyro_sigma);
  StereoModel::Options& stereo = invariant.stereo;
  section.read("pixel_sigma", Range::positive(), stereo.pixel_sigma);
  section.read("min_disparity", Range::positive(), stereo.min_disparity);
  section.read("max_depth_m", Range::halfOpen(stereo.min_depth_m, 1e6), stereo.max_depth_m);
  section.read("consensus_sigmas", Range::positive(), invariant.update.consensus_sigmas);
  section.read("gate", Range::positive(), invariant.update.gate);
  section.read("frame_gate", Range::positive(), invariant.update.frame_gate);
  section.read("divergence_window_s", Range::closed(0.0, 3600.0), invariant.recovery.monitor.window_s);
  section.read("slip_sigma", Range::closed(0.0, 0.5), invariant.slip.sigma);
  section.read("slip_rotation_sigma", Range::closed(0.0, 0.1), invariant.slip.rotation_sigma);
  section.read("standstill_px", Range::notNegative(), invariant.standstill_px);
  section.read("max_tracked", Range::closed(1.0, 1e5), invariant.max_tracked);
  section.finish();
}

/// A file that a configuration names.
std::string fileIn(const std::filesystem::path& folder, const std::string& named) {
  return named.empty() ? named : (folder / named).string();
}

/// Of such a file; what is wrong with it is said together with the key that names it.
template <typename Read>
auto readNamed(const YamlSection& section, const std::string& key, const std::string& path, Read read) {
  try {
    return read(path);
  } catch (const ConfigError& e) {
    throw ConfigError(section.nameOf(key) + ": " + e.what());
  }
}

void readInertial(YamlSection section, const std::string& folder, Inertial::Options& inertial) {
  std::string calibration;
  section.read("imu_calibration", calibration);
  Eigen::VectorXd noise(4), bias(2);
  ImuNoise& n = inertial.noise;
  noise << n.gyro_density, n.accelerometer_density, n.gyro_walk, n.accelerometer_walk;
  bias << inertial.gyro_bias_sigma, inertial.accelerometer_bias_sigma;
  section.read("imu_noise", Range::positive(), noise);
  section.read("imu_bias_sigma", Range::positive(), bias);
  section.read("accelerometer_scale_sigma", Range::closed(0.0, 0.3), inertial.accelerometer_scale_sigma);
  section.read("gravity", Range::closed(1.0, 30.0), inertial.gravity);
  section.finish();
  n = {noise[0], noise[1], noise[2], noise[3]};
  inertial.gyro_bias_sigma = bias[0];
  inertial.accelerometer_bias_sigma = bias[1];
  if (calibration.empty()) return;
  inertial.noise_file = fileIn(folder, calibration);
  n = readNamed(section, "imu_calibration", inertial.noise_file, readImuCalibration);
  inertial.noise_given = true;
}

void readCalibration(YamlSection section, const std::string& folder, RigVariables::Options& rig) {
  std::string file;
  double rotation = rig.rotation_sigma[0], translation = rig.translation_sigma[0];
  section.read("file", file);
  section.read("rotation_sigma", Range::closed(0.0, 0.2), rotation);
  section.read("translation_sigma", Range::closed(0.0, 1.0), translation);
  section.read("time_offset", Range::closed(-1.0, 1.0), rig.time_offset);
  section.read("time_offset_sigma", Range::closed(0.0, 0.2), rig.time_offset_sigma);
  section.read("scale_sigma", Range::closed(0.0, 0.2), rig.scale_sigma);
  section.finish();
  rig.rotation_sigma.setConstant(rotation);
  rig.translation_sigma.setConstant(translation);
  if (file.empty()) return;
  const RigEstimate known = readNamed(section, "file", fileIn(folder, file), readRigCalibration);
  rig.known = {known.rig.cam_T_imu, known.rig.camera.baseline, known.recording};
  rig.time_offset = known.time_offset;
  // What is to be estimated goes on from there.
  if (rotation > 0.0 && known.rotation_sigma.minCoeff() > 0.0) rig.rotation_sigma = known.rotation_sigma;
  if (translation > 0.0 && known.translation_sigma.minCoeff() > 0.0)
    rig.translation_sigma = known.translation_sigma;
  if (rig.time_offset_sigma > 0.0 && known.time_offset_sigma > 0.0)
    rig.time_offset_sigma = known.time_offset_sigma;
  if (rig.scale_sigma > 0.0 && known.baseline_sigma > 0.0)
    rig.scale_sigma = known.baseline_sigma / known.rig.camera.baseline;
}

void readMap(YamlSection section, InvariantConfig& invariant) {
  LandmarkMap::Options& map = invariant.map;
  section.readChoice<MapKeep>(
      "keep", {{"none", MapKeep::kNone}, {"good", MapKeep::kGood}, {"all", MapKeep::kAll}}, map.keep);
  section.read("min_track_s", Range::closed(0.0, 1e6), map.min_track_s);
  section.read("max_landmarks", Range::closed(0.0, 20000.0), map.max_landmarks);
  section.readChoice<PlaceRecognition>("recognise_places",
                                       {{"false", PlaceRecognition::kNone},
                                        {"descriptors", PlaceRecognition::kDescriptors},
                                        {"constellation", PlaceRecognition::kConstellation}},
                                       invariant.recognise_places);
  section.finish();
}

/// Parts of the invariant filter that a study may switch off to see what they bring; no vehicle asks for it.
void readStudies(YamlSection section, InvariantConfig& invariant) {
  section.read("consensus", invariant.update.consensus);
  section.read("unbiased_starts", invariant.stereo.unbiased_starts);
  section.read("plausible_gate", Range::positive(), invariant.update.plausible_gate);
  section.read("motion_gate", Range::positive(), invariant.update.motion_gate);
  section.read("divergence_jump_m", Range::closed(0.0, 1e6), invariant.recovery.jump_m);
  section.finish();
}

} // namespace

Config parseConfig(const YAML::Node& document, const std::string& source,
                   const std::vector<std::string>& other_sections, const std::string& folder) {
  Config config;
  YamlSection root = YamlSection::root(document, source);
  root.readChoice<EstimatorType>("estimator",
                                 {{"invariant", EstimatorType::kInvariant}, {"paper", EstimatorType::kPaper}},
                                 config.estimator);
  readBuffer(root.section("buffer"), config.buffer);
  root.readChoice<MotionChoice>("motion",
                                {{"auto", MotionChoice::kAuto},
                                 {"constant_twist", MotionChoice::kConstantTwist},
                                 {"inertial", MotionChoice::kInertial}},
                                config.invariant.choice);
  readInvariant(root.section("invariant"), config.invariant);
  readInertial(root.section("inertial"), folder, config.invariant.inertial);
  config.invariant.inertial.velocity_sigma = config.invariant.motion.prior_twist_sigma[0];
  config.invariant.inertial.measured_velocity_sigma = config.invariant.motion.velocity_sigma;
  readCalibration(root.section("calibration"), folder, config.invariant.rig);
  readMap(root.section("map"), config.invariant);
  readPaper(root.section("paper"), config.paper);
  readStudies(root.section("studies"), config.invariant);
  for (const auto& section : other_sections) root.allow(section);
  root.finish();
  return config;
}

} // namespace vi_ekf_slam

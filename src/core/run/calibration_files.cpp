#include "vi_ekf_slam/core/run/calibration_files.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/run/yaml_section.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFarthestPart = 100.0;       // m, between parts of a rig
constexpr double kLatestStamp = 4294967295.0; // s, what a message's stamp can hold
constexpr double kAnyNumber = 1e12;           // that is finite and may be squared

/// OpenCV's first line, which is not YAML.
std::string withoutDirective(const std::string& yaml) {
  return yaml.rfind("%YAML:", 0) == 0 ? yaml.substr(std::min(yaml.find('\n'), yaml.size())) : yaml;
}

/// Of `position` and `orientation` (x, y, z, w); positions are in `place`.
SE3 readPose(YamlSection& root, const Range& place) {
  const Eigen::Vector3d p = root.required("position", place, 3);
  const Eigen::Vector4d q = root.required("orientation", Range::closed(-kAnyNumber, kAnyNumber), 4);
  if (std::abs(q.norm() - 1.0) > 1e-3)
    root.fail("orientation", "of norm " + std::to_string(q.norm()), "a quaternion of norm 1");
  return SE3(Eigen::Quaterniond(q).normalized().toRotationMatrix(), p);
}

std::string numberText(double number) { return rounded(number, 12); }

std::string listOf(const Eigen::VectorXd& numbers) {
  std::string text;
  for (Eigen::Index i = 0; i < numbers.size(); ++i) text += (i == 0 ? "[" : ", ") + numberText(numbers[i]);
  return text + "]";
}

} // namespace

ImuNoise readImuCalibration(const std::string& path) {
  YamlSection root = YamlSection::root(withoutDirective(readYamlFile(path)), path);
  YamlSection imu = root.has("imu0") ? root.section("imu0") : root;
  ImuNoise noise;
  constexpr double kLargest = 1e6; // beyond any unit that may be mistaken
  noise.gyro_density = imu.required("gyroscope_noise_density", Range::halfOpen(0.0, kLargest));
  noise.accelerometer_density = imu.required("accelerometer_noise_density", Range::halfOpen(0.0, kLargest));
  noise.gyro_walk = imu.required("gyroscope_random_walk", Range::closed(0.0, kLargest));
  noise.accelerometer_walk = imu.required("accelerometer_random_walk", Range::closed(0.0, kLargest));
  return noise;
}

InitialState readInitialState(const std::string& path) {
  YamlSection root = YamlSection::root(readYamlFile(path), path);
  const Range any = Range::closed(-kAnyNumber, kAnyNumber);
  InitialState state;
  state.stamp = root.stamp("stamp");
  state.world_T_imu = readPose(root, any);
  state.velocity = root.required("velocity", any, 3);
  state.gyro_bias = root.required("gyro_bias", any, 3);
  state.accelerometer_bias = root.required("accelerometer_bias", any, 3);
  const Eigen::VectorXd entries = root.required("covariance", any, 225);
  state.covariance = Eigen::Map<const Eigen::Matrix<double, 15, 15>>(entries.data());
  if (const auto bad = badFieldOf(state)) root.fail(bad->name, bad->value, bad->allowed);
  state.covariance = (0.5 * (state.covariance + state.covariance.transpose())).eval();
  root.finish();
  return state;
}

std::string rigCalibrationText(const RigEstimate& e) {
  const Eigen::Quaterniond q(e.rig.cam_T_imu.rotation());
  return "# The calibration as a run of vi_ekf_slam estimated it; calibration/file of a configuration takes "
         "it.\n"
         "# cam_T_imu takes points from the IMU's frame to the left camera's. A sigma of 0: it was taken as "
         "known.\n"
         "position: " +
         listOf(e.rig.cam_T_imu.translation()) + "  # m, of cam_T_imu\norientation: " + listOf(q.coeffs()) +
         "  # x, y, z, w\nbaseline: " + numberText(e.rig.camera.baseline) +
         "  # m\ntime_offset: " + numberText(e.time_offset) +
         "  # s, to be added to a picture's stamp\nrotation_sigma: " + listOf(e.rotation_sigma) +
         "  # rad, along the camera's axes\ntranslation_sigma: " + listOf(e.translation_sigma) +
         "  # m, the same\ntime_offset_sigma: " + numberText(e.time_offset_sigma) +
         "  # s\nbaseline_sigma: " + numberText(e.baseline_sigma) +
         "  # m\nrecording: " + listOf(e.recording) +
         "  # s, first and last stamp of what it was estimated from\n";
}

RigEstimate readRigCalibration(const std::string& path) {
  YamlSection root = YamlSection::root(readYamlFile(path), path);
  const Range sigma = Range::closed(0.0, 1.0);
  RigEstimate e;
  e.rig.cam_T_imu = readPose(root, Range::closed(-kFarthestPart, kFarthestPart));
  e.rig.camera.baseline = root.required("baseline", Range::halfOpen(0.0, kFarthestPart));
  e.time_offset = root.required("time_offset", Range::closed(-1.0, 1.0));
  e.rotation_sigma = root.required("rotation_sigma", sigma, 3);
  e.translation_sigma = root.required("translation_sigma", sigma, 3);
  e.time_offset_sigma = root.required("time_offset_sigma", sigma);
  e.baseline_sigma = root.required("baseline_sigma", sigma);
  root.read("recording", Range::closed(0.0, kLatestStamp), e.recording); // earlier versions wrote none
  root.finish();
  return e;
}

} // namespace vi_ekf_slam

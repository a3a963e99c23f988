#include "vi_ekf_slam/core/run/imu_calibration.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam {
namespace {

/// OpenCV's first line, which is not YAML.
std::string withoutDirective(const std::string& yaml) {
  return yaml.rfind("%YAML:", 0) == 0 ? yaml.substr(std::min(yaml.find('\n'), yaml.size())) : yaml;
}

Eigen::VectorXd required(YamlSection& section, const std::string& key, Eigen::Index size) {
  constexpr double kLargest = 1e12;
  return section.required(key, Range::closed(-kLargest, kLargest), size);
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
  InitialState state;
  state.stamp = root.stamp("stamp");
  const Eigen::VectorXd p = required(root, "position", 3), q = required(root, "orientation", 4);
  if (std::abs(q.norm() - 1.0) > 1e-3)
    root.fail("orientation", "of norm " + std::to_string(q.norm()), "a quaternion of norm 1");
  state.world_T_imu =
      SE3(Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized().toRotationMatrix(), p.head<3>());
  state.velocity = required(root, "velocity", 3);
  state.gyro_bias = required(root, "gyro_bias", 3);
  state.accelerometer_bias = required(root, "accelerometer_bias", 3);
  const Eigen::VectorXd entries = required(root, "covariance", 225);
  state.covariance = Eigen::Map<const Eigen::Matrix<double, 15, 15>>(entries.data());
  if (const auto bad = badFieldOf(state)) root.fail(bad->name, bad->value, bad->allowed);
  state.covariance = (0.5 * (state.covariance + state.covariance.transpose())).eval();
  root.finish();
  return state;
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/run/rig_calibration.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <sstream>

#include "vi_ekf_slam/core/run/yaml_section.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kFarthest = 100.0;      // m, between parts of a rig
constexpr double kLatest = 4294967295.0; // s, what a message's stamp can hold

std::string list(const Eigen::VectorXd& numbers) {
  std::ostringstream text;
  text.precision(12);
  for (Eigen::Index i = 0; i < numbers.size(); ++i) text << (i == 0 ? "[" : ", ") << numbers[i];
  return text.str() + "]";
}

} // namespace

std::string rigCalibrationText(const RigEstimate& e) {
  const Eigen::Quaterniond q(e.rig.cam_T_imu.rotation());
  const auto one = [](double value) { return list(Eigen::VectorXd::Constant(1, value)); };
  const auto number = [&one](double value) { return one(value).substr(1, one(value).size() - 2); };
  return "# The calibration as a run of vi_ekf_slam estimated it; calibration/file of a configuration takes "
         "it.\n"
         "# cam_T_imu takes points from the IMU's frame to the left camera's. A sigma of 0: it was taken as "
         "known.\n"
         "position: " +
         list(e.rig.cam_T_imu.translation()) + "  # m, of cam_T_imu\norientation: " + list(q.coeffs()) +
         "  # x, y, z, w\nbaseline: " + number(e.rig.camera.baseline) +
         "  # m\ntime_offset: " + number(e.time_offset) +
         "  # s, to be added to a picture's stamp\nrotation_sigma: " + list(e.rotation_sigma) +
         "  # rad, along the camera's axes\ntranslation_sigma: " + list(e.translation_sigma) +
         "  # m, the same\ntime_offset_sigma: " + number(e.time_offset_sigma) +
         "  # s\nbaseline_sigma: " + number(e.baseline_sigma) + "  # m\nrecording: " + list(e.recording) +
         "  # s, first and last stamp of what it was estimated from\n";
}

RigEstimate readRigCalibration(const std::string& path) {
  YamlSection root = YamlSection::root(readYamlFile(path), path);
  const Range place = Range::closed(-kFarthest, kFarthest), sigma = Range::closed(0.0, 1.0);
  const Eigen::Vector3d p = root.required("position", place, 3);
  const Eigen::Vector4d q = root.required("orientation", Range::closed(-1.001, 1.001), 4);
  if (std::abs(q.norm() - 1.0) > 1e-3)
    root.fail("orientation", "of norm " + std::to_string(q.norm()), "a quaternion of norm 1");
  RigEstimate e;
  e.rig.cam_T_imu = SE3(Eigen::Quaterniond(q).normalized().toRotationMatrix(), p);
  e.rig.camera.baseline = root.required("baseline", Range::halfOpen(0.0, kFarthest));
  e.time_offset = root.required("time_offset", Range::closed(-1.0, 1.0));
  e.rotation_sigma = root.required("rotation_sigma", sigma, 3);
  e.translation_sigma = root.required("translation_sigma", sigma, 3);
  e.time_offset_sigma = root.required("time_offset_sigma", sigma);
  e.baseline_sigma = root.required("baseline_sigma", sigma);
  root.read("recording", Range::closed(0.0, kLatest), e.recording); // earlier versions wrote none
  root.finish();
  return e;
}

} // namespace vi_ekf_slam

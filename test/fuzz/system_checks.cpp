#include "system_checks.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>

namespace vi_ekf_slam::fuzz {
namespace {

template <typename Matrix>
void checkCovariance(const Matrix& P, const char* what) {
  const bool good = P.allFinite() && (P.diagonal().array() >= 0.0).all() &&
                    (P - P.transpose()).cwiseAbs().maxCoeff() <= 1e-9 * P.cwiseAbs().maxCoeff();
  if (!good) std::cerr << P << "\n";
  require(good, what);
}

} // namespace

void require(bool law, const char* what) {
  if (law) return;
  std::fprintf(stderr, "broken: %s\n", what);
  std::abort();
}

void checkOutput(const Output& output) {
  for (const SE3& pose : {output.state.world_T_imu, output.odom_T_imu}) {
    require(pose.translation().allFinite(), "a position is finite");
    const Eigen::Matrix3d& R = pose.rotation();
    require(R.allFinite() && (R * R.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6 &&
                R.col(0).cross(R.col(1)).dot(R.col(2)) > 0.0,
            "a rotation is one");
  }
  require(output.state.twist.allFinite(), "the twist is finite");
  checkCovariance(output.state.pose_covariance,
                  "the pose's covariance is finite, symmetric, its diagonal not negative");
  checkCovariance(output.state.twist_covariance,
                  "the twist's covariance is finite, symmetric, its diagonal not negative");
  const FrameReport& report = output.report;
  require(report.invalid + report.used + report.rejected <= report.features, "no feature is counted twice");
  require(std::isfinite(report.nis) && report.nis >= 0.0, "the innovation is finite");
}

void checkLandmarks(const Estimator& estimator, std::size_t most) {
  const auto landmarks = estimator.landmarks();
  require(landmarks.size() <= most, "the map is bounded");
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    require(i == 0 || landmarks[i - 1].id < landmarks[i].id, "landmarks are in the order of their ids");
    require(landmarks[i].position.allFinite(), "a landmark's position is finite");
    checkCovariance(landmarks[i].covariance,
                    "a landmark's covariance is finite, symmetric, its diagonal not negative");
  }
}

void watch(SlamSystem& system) {
  system.onFrame(checkOutput);
  system.onImu(checkOutput);
}

} // namespace vi_ekf_slam::fuzz

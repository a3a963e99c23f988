#pragma once

#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "numeric.hpp"
#include "vi_ekf_slam/core/geometry/camera.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/slam/config.hpp"

/// A stereo rig and what it sees along a street.
namespace vi_ekf_slam::test {

inline SE3 noseToOptical() {
  Eigen::Matrix3d R; // the IMU looks along x, the camera along z
  R << 0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0;
  return {R, {0.05, -0.1, 0.2}};
}

inline StereoRig exampleRig() { return {{718.0, 552.0, 607.0, 185.0, 0.54}, noseToOptical()}; }

/// Where the pair of exampleRig(), whose pictures have 1240 x 370 px, sees a point of the world (m); empty:
/// nearer than 2 m, beyond `farthest`, or out of the picture.
inline std::optional<StereoPixels> seen(const Eigen::Vector3d& point, const SE3& world_T_imu,
                                        double farthest = std::numeric_limits<double>::infinity()) {
  static const StereoRig rig = exampleRig();
  const Eigen::Vector3d p = rig.cam_T_imu * world_T_imu.inverse() * point;
  if (p.z() < 2.0 || p.z() > farthest) return std::nullopt;
  const StereoPixels z = rig.camera.project(p);
  if (z[0] < 0.0 || z[0] > 1240.0 || z[2] < 0.0 || z[1] < 0.0 || z[1] > 370.0) return std::nullopt;
  return z;
}

/// A drive along a street of landmarks: they come into view ahead and leave it beside the vehicle.
class Street {
 public:
  Street(unsigned seed, int landmarks) : random_(seed) {
    for (int i = 0; i < landmarks; ++i) {
      points_.emplace_back(random_.uniform(4.0, 40.0), random_.uniform(-8.0, 8.0),
                           random_.uniform(-1.5, 3.0));
    }
  }

  /// What the pair sees from `world_T_imu`, each pixel off by up to `noise`.
  StereoFrame frame(Stamp stamp, const SE3& world_T_imu, double noise) {
    StereoFrame frame;
    frame.stamp = stamp;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const auto z = seen(points_[i], world_T_imu, 15.0);
      if (!z) continue;
      frame.features.push_back({static_cast<FeatureId>(i), *z + random_.vector<4>(-noise, noise)});
    }
    return frame;
  }

  const std::vector<Eigen::Vector3d>& points() const { return points_; }

 private:
  Random random_;
  std::vector<Eigen::Vector3d> points_;
};

/// 2 m/s ahead in a gentle turn with some sway.
inline Vector6d streetTwist(double t) {
  Vector6d u;
  u << 2.0, 0.1 * std::sin(t), 0.05, 0.02, 0.03 * std::cos(2.0 * t), 0.1;
  return u;
}

/// The paper's filter with noises at which the camera counts.
inline PaperConfig sharpConfig(PaperMode mode) {
  PaperConfig config;
  config.mode = mode;
  config.pixel_noise = 4.0;
  config.prior_landmark_variance = 2.0;
  config.landmark_fraction = 1.0;
  return config;
}

} // namespace vi_ekf_slam::test

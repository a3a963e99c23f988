#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/simulation/drive_options.hpp"
#include "vi_ekf_slam/simulation/random.hpp"

namespace vi_ekf_slam::simulation {

/// Another car: points that move together, at constant velocity.
struct MovingObject {
  std::uint64_t id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero(); ///< world, m
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero(); ///< world, m/s
  std::vector<Eigen::Vector3d> points;                ///< relative to `position`, world axes, m
  double absent = 0.0;                                ///< s until it appears
  double life = 0.0;                                  ///< s that it then stays

  bool present() const { return absent <= 0.0; }
};

/// Cars ahead of ours, at nearly its speed, and oncoming ones. One that has gone comes back as another.
class Traffic {
 public:
  explicit Traffic(const DriveOptions& options);

  /// Moves on by `dt` s; `twist` is ours, in the IMU frame.
  void step(double dt, const SE3& world_T_imu, const Vector6d& twist);
  const std::vector<MovingObject>& objects() const { return objects_; }

 private:
  void appear(MovingObject& object, const SE3& world_T_imu, const Vector6d& twist);

  Random random_;
  std::vector<MovingObject> objects_;
  std::uint64_t next_id_ = 1;
};

} // namespace vi_ekf_slam::simulation

#include "vi_ekf_slam/simulation/traffic.hpp"

#include <algorithm>

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kLongestAbsence = 8.0; // s
constexpr double kGround = -0.93;       // m, height of the street in the IMU frame
constexpr double kOtherLane = 3.5;      // m to the left

} // namespace

Traffic::Traffic(const DriveOptions& options) : random_(options.seed, RandomStream::kTraffic) {
  objects_.resize(static_cast<std::size_t>(options.moving_objects));
  for (MovingObject& object : objects_) object.absent = random_.uniform(0.0, kLongestAbsence);
}

void Traffic::step(double dt, const SE3& world_T_imu, const Vector6d& twist) {
  for (MovingObject& object : objects_) {
    if (object.present()) {
      object.position += dt * object.velocity;
      object.life -= dt;
      if (object.life <= 0.0) object.absent = random_.uniform(0.1, kLongestAbsence);
    } else {
      object.absent -= dt;
      if (object.present()) appear(object, world_T_imu, twist);
    }
  }
}

void Traffic::appear(MovingObject& object, const SE3& world_T_imu, const Vector6d& twist) {
  object.id = next_id_++;
  object.life = random_.uniform(4.0, 12.0);
  const bool oncoming = random_.uniform() < 0.5;
  const double ahead = oncoming ? random_.uniform(40.0, 80.0) : random_.uniform(12.0, 35.0);
  const double speed =
      oncoming ? -random_.uniform(5.0, 12.0) : std::max(3.0, twist[0]) * random_.uniform(0.85, 1.2);
  object.position = world_T_imu * Eigen::Vector3d(ahead, oncoming ? kOtherLane : 0.0, kGround);
  object.velocity = world_T_imu.rotation() * Eigen::Vector3d(speed, 0.0, 0.0);
  object.points.clear();
  const int count = random_.integer(5, 10);
  for (int i = 0; i < count; ++i) {
    const double x = random_.uniform(-0.3, 0.3), y = random_.uniform(-0.9, 0.9),
                 z = random_.uniform(0.3, 1.4);
    object.points.push_back(world_T_imu.rotation() * Eigen::Vector3d(x, y, z));
  }
}

} // namespace vi_ekf_slam::simulation

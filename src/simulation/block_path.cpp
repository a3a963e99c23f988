#include "vi_ekf_slam/simulation/block_path.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kPi = 3.141592653589793;
constexpr double kRadius = 8.0;     // m, of the corners
constexpr double kWheelbase = 3.0;  // m
constexpr double kImuHeight = 0.93; // m
constexpr double kHill = 0.5;       // m, amplitude over a lap
constexpr double kStart = 10.0;     // m of straight that lie behind station 0

Eigen::Matrix2d quarterTurns(int n) {
  constexpr int kCos[] = {1, 0, -1, 0};
  Eigen::Matrix2d R;
  R << kCos[n % 4], -kCos[(n + 3) % 4], kCos[(n + 3) % 4], kCos[n % 4];
  return R;
}

} // namespace

BlockPath::BlockPath(double length, double width)
    : length_(length),
      width_(width),
      perimeter_(2.0 * (length - 2.0 * kRadius) + 2.0 * (width - 2.0 * kRadius) + 2.0 * kPi * kRadius) {}

double BlockPath::wrapped(double s) const {
  const double x = std::fmod(s + kStart, perimeter_);
  return x < 0.0 ? x + perimeter_ : x;
}

Eigen::Vector2d BlockPath::point(double s) const {
  double rest = wrapped(s);
  for (int side = 0; side < 4; ++side) {
    const double along = side % 2 == 0 ? length_ : width_;
    const double across = side % 2 == 0 ? width_ : length_;
    const double straight = along - 2.0 * kRadius;
    const Eigen::Matrix2d R = quarterTurns(side);
    if (rest < straight) return R * Eigen::Vector2d(rest - 0.5 * straight, -0.5 * across);
    rest -= straight;
    const double arc = 0.5 * kPi * kRadius;
    if (rest < arc || side == 3) {
      const double a = rest / kRadius;
      return R * Eigen::Vector2d(0.5 * straight + kRadius * std::sin(a),
                                 -0.5 * across + kRadius * (1.0 - std::cos(a)));
    }
    rest -= arc;
  }
  return Eigen::Vector2d::Zero(); // not reached: the fourth side takes the rest
}

double BlockPath::height(double s) const { return kHill * std::sin(2.0 * kPi * s / perimeter_); }

double BlockPath::distanceToCorner(double s) const {
  double rest = wrapped(s);
  for (int side = 0; side < 4; ++side) {
    const double straight = (side % 2 == 0 ? length_ : width_) - 2.0 * kRadius;
    if (rest < straight) return straight - rest;
    rest -= straight + 0.5 * kPi * kRadius;
    if (rest < 0.0) return 0.0;
  }
  return 0.0;
}

SE3 BlockPath::path_T_imu(double s) const {
  const Eigen::Vector2d p = point(s);
  const Eigen::Vector2d chord = point(s + 0.5 * kWheelbase) - point(s - 0.5 * kWheelbase);
  const double slope = kHill * 2.0 * kPi / perimeter_ * std::cos(2.0 * kPi * s / perimeter_);
  const double yaw = std::atan2(chord.y(), chord.x());
  const double pitch = -std::atan(slope) + 0.004 * std::sin(s / 5.0) + 0.003 * std::sin(s / 1.9);
  const double roll = 0.006 * std::sin(s / 7.0) + 0.003 * std::sin(s / 2.3);
  const Eigen::Matrix3d R =
      so3::Exp({0.0, 0.0, yaw}) * so3::Exp({0.0, pitch, 0.0}) * so3::Exp({roll, 0.0, 0.0});
  return {R, {p.x(), p.y(), height(s) + kImuHeight}};
}

} // namespace vi_ekf_slam::simulation

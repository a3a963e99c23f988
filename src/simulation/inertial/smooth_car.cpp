#include "vi_ekf_slam/simulation/inertial/smooth_car.hpp"

#include <cmath>

#include "vi_ekf_slam/simulation/inertial/quintic_spline.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kKnot = 0.5;       // s between the spline's stations
constexpr int kStepsPerKnot = 5;    // of the car whose stations they are
constexpr double kPathKnot = 2.0;   // m between its poses
constexpr double kHeave = 0.01;     // m
constexpr double kHeaveScale = 2.7; // m / rad: 10 s^-1 at 27 m/s

/// What the spline takes away from a stop at either end.
constexpr double kSmoothed = SplineWeights::kReach * kKnot;

/// The car whose stations are smoothed: it stands so much longer that ours stands as long as told.
DriveOptions longerStops(DriveOptions options) {
  if (options.standing_start > 0.0) options.standing_start += kSmoothed;
  if (options.corner_stop > 0.0) options.corner_stop += 2.0 * kSmoothed;
  return options;
}

} // namespace

SmoothCarTrajectory::SmoothCarTrajectory(const DriveOptions& options)
    : path_(options.block_length, options.block_width) {
  CarMotion car(longerStops(options));
  const double aim = options.laps * path_.perimeter();
  const auto arrived = [&] {
    const double time = kKnot * static_cast<double>(stations_.size());
    return options.duration > 0.0 ? time > options.duration : car.distance() > aim;
  };
  const auto addKnot = [&] {
    stations_.push_back(car.distance());
    for (int i = 0; i < kStepsPerKnot; ++i) car.step(kKnot / kStepsPerKnot);
  };
  do addKnot();
  while (!arrived() || stations_.size() < 2);
  for (int i = 0; i <= 2 * SplineWeights::kReach; ++i) addKnot();
}

double SmoothCarTrajectory::stationControl(long i) const {
  const long last = static_cast<long>(stations_.size()) - 1;
  if (i < 0) return stations_[0] + static_cast<double>(i) * (stations_[1] - stations_[0]);
  if (i <= last) return stations_[static_cast<std::size_t>(i)];
  const auto end = stations_.end();
  return end[-1] + static_cast<double>(i - last) * (end[-1] - end[-2]);
}

/// The yaw that is next to `yaw_nearby`.
PoseCoordinates SmoothCarTrajectory::poseControl(long i, double yaw_nearby) const {
  const double s = static_cast<double>(i) * kPathKnot;
  const SE3 pose = path_.path_T_imu(s);
  const Eigen::Matrix3d& R = pose.rotation();
  PoseCoordinates q;
  q << pose.translation(), std::atan2(R(1, 0), R(0, 0)), -std::asin(R(2, 0)), std::atan2(R(2, 1), R(2, 2));
  q[2] += kHeave * std::sin(s / kHeaveScale);
  q[3] += kTurn * std::round((yaw_nearby - q[3]) / kTurn);
  return q;
}

double SmoothCarTrajectory::distance(double t) const {
  return SplinePoint<double>(t / kKnot, 0.0, [this](long i) { return stationControl(i); }).value;
}

Kinematics SmoothCarTrajectory::at(double t) const {
  const SplinePoint<double> station(t / kKnot, 0.0, [this](long i) { return stationControl(i); });
  const double u = station.value / kPathKnot, du = station.rate / (kKnot * kPathKnot),
               ddu = station.acceleration / (kKnot * kKnot * kPathKnot);
  const double yaw = poseControl(std::lround(u), 0.0)[3];
  const SplinePoint<PoseCoordinates> pose(u, PoseCoordinates::Zero(),
                                          [&](long i) { return poseControl(i, yaw); });
  return kinematicsOf({pose.value, du * pose.rate, du * du * pose.acceleration + ddu * pose.rate});
}

} // namespace vi_ekf_slam::simulation

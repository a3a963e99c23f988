#include "vi_ekf_slam/simulation/track_drift.hpp"

#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr double kTimeConstant = 0.5; // s

Vector6d normal6(Random& random) {
  Vector6d v;
  v << random.normal3(), random.normal3();
  return v;
}

} // namespace

TrackDrift::TrackDrift(const DriveOptions& options) : random_(options.seed, RandomStream::kTrackDrift) {
  density_ << Eigen::Vector3d::Constant(options.drift_position),
      Eigen::Vector3d::Constant(options.drift_rotation);
}

void TrackDrift::advance(Stamp stamp, const SE3& world_T_imu) {
  const Eigen::Vector3d position = world_T_imu.translation();
  // The integral of a Gauss-Markov process of this variance grows as a random walk of unit density.
  const double sigma = std::sqrt(0.5 / kTimeConstant);
  if (!stamp_) {
    rate_ = sigma * normal6(random_);
  } else {
    const double dt = secondsBetween(*stamp_, stamp);
    const double distance = (position - position_).norm();
    if (dt > 0.0) {
      const Vector6d moved = std::sqrt(distance * dt) * density_.cwiseProduct(rate_);
      const Eigen::Matrix3d R = so3::Exp(moved.tail<3>());
      slide_ = SE3(R, position - R * position + moved.head<3>()) * slide_;
      const double keep = std::exp(-dt / kTimeConstant);
      rate_ = keep * rate_ + sigma * std::sqrt(1.0 - keep * keep) * normal6(random_);
    }
  }
  stamp_ = stamp;
  position_ = position;
}

} // namespace vi_ekf_slam::simulation

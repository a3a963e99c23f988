#pragma once

#include <Eigen/Core>
#include <optional>

namespace vi_ekf_slam {

/// What is to be added to the stamps of pictures to have those of a gyro, from how differently the two say
/// that a body turned. Where its rate goes from w0 to w1 over a time in which it turns by R, pictures of
/// another clock see it turned by tau (w1 - R^T w0) more, in its axes at the end; a bias of the gyro is the
/// same each time. Least squares.
class ClockOffset {
 public:
  /// `change` = w1 - R^T w0 (rad/s); `apart`: Log of the gyro's turn^T times the pictures' (rad), of `sigma`
  /// on each axis.
  void add(const Eigen::Vector3d& change, const Eigen::Vector3d& apart, double sigma);

  struct Estimate {
    double tau, sigma; ///< s
  };
  /// `sigma` is larger where the turns are farther apart than is said. Nothing while two times cannot tell.
  std::optional<Estimate> estimate() const;
  int count() const { return count_; }

 private:
  int count_ = 0;
  double weight_ = 0.0; ///< sum of 1 / sigma^2, and so weighted:
  Eigen::Vector3d change_ = Eigen::Vector3d::Zero(), apart_ = Eigen::Vector3d::Zero();
  double change_change_ = 0.0, change_apart_ = 0.0, apart_apart_ = 0.0;
};

} // namespace vi_ekf_slam

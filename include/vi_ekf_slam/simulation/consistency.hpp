#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <utility>

#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam::simulation {

/// Normalised estimation error squared of one pose: e^T P^-1 e, whose mean is the number of its degrees of
/// freedom when the covariance P tells the truth about the error e. Not a number when P is not positive
/// definite.
struct PoseNees {
  double pose = 0.0;     ///< 6 degrees of freedom
  double rotation = 0.0; ///< 3, by its marginal covariance
  double position = 0.0; ///< 3, by its marginal covariance
};

/// Right-invariant error xi = Log(T_true T_estimated^-1), (position in m, rotation in rad), world axes:
/// T_true = Exp(xi) T_estimated. Barrau and Bonnabel, "An EKF-SLAM algorithm with consistency properties",
/// 2015.
Vector6d invariantError(const SE3& truth, const SE3& estimate);

/// Covariance of the right-invariant error (6x6). StateEstimate's position error is dp = xi_p - [p]x xi_R, so
/// xi = [[I, [p]x], [0, I]] (dp, dtheta).
Matrix6d invariantCovariance(const StateEstimate& estimate);

/// In the right-invariant coordinates, for error and covariance alike.
PoseNees poseNees(const SE3& truth, const StateEstimate& estimate);

/// Of the rotation about the two horizontal axes of the world, 2 degrees of freedom.
double tiltNees(const SE3& truth, const StateEstimate& estimate);

/// Of the velocity along the IMU's axes, m/s, 3 degrees of freedom.
double velocityNees(const Eigen::Vector3d& truth, const StateEstimate& estimate);

/// RMS distance (m) of the points `estimate` from those of `truth` (3 x n, column by column), after the rigid
/// motion that brings them closest: the ATE. Where gravity is known (`is_level`) that motion is a translation
/// and a turn about the z axis.
double absoluteTrajectoryError(const Eigen::Matrix3Xd& estimate, const Eigen::Matrix3Xd& truth,
                               bool is_level);

/// Bounds between which the mean of `runs` independent chi-square values of `dof` degrees of freedom lies
/// with probability 0.95 (Wilson and Hilferty 1931; good to 0.3 % from 30 degrees of freedom in total).
std::pair<double, double> chiSquareMeanBounds(double dof, double runs);

/// Whether a feature came back: an id that was seen, then not, then again.
class ReturnWatch {
 public:
  void add(const StereoFrame& frame);
  bool returned() const { return returned_; }

 private:
  std::map<FeatureId, std::size_t> last_seen_; ///< frame in which an id was seen last
  std::size_t frames_ = 0;
  bool returned_ = false;
};

/// Watches the variance of the rotation about the world's z axis. Nothing measures the global yaw before a
/// landmark is seen again, so until then the variance must not fall.
class YawVarianceWatch {
 public:
  /// One frame's pose_covariance (StateEstimate's convention).
  void add(const Matrix6d& pose_covariance);
  /// Largest fall from one frame to the next, relative to the value before; 0 when it never fell.
  double largestFall() const { return largest_fall_; }

 private:
  std::optional<double> last_;
  double largest_fall_ = 0.0;
};

} // namespace vi_ekf_slam::simulation

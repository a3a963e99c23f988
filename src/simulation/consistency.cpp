#include "vi_ekf_slam/simulation/consistency.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam::simulation {
namespace {

/// e^T P^-1 e by P = L L^T. The rows are scaled to a unit diagonal first: m^2 and rad^2 differ by orders of
/// magnitude.
template <int N>
double nees(const Eigen::Matrix<double, N, 1>& error, const Eigen::Matrix<double, N, N>& covariance) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  if (!(covariance.diagonal().minCoeff() > 0.0) || !covariance.allFinite() || !error.allFinite()) return kNan;
  const Eigen::Matrix<double, N, 1> scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix<double, N, N> scaled = scale.asDiagonal() * covariance * scale.asDiagonal();
  const Eigen::LLT<Eigen::Matrix<double, N, N>> llt(scaled);
  if (llt.info() != Eigen::Success) return kNan;
  return llt.matrixL().solve(scale.cwiseProduct(error)).squaredNorm();
}

} // namespace

Vector6d invariantError(const SE3& truth, const SE3& estimate) { return (truth * estimate.inverse()).Log(); }

Matrix6d invariantCovariance(const StateEstimate& estimate) {
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = so3::hat(estimate.world_T_imu.translation());
  return J * estimate.pose_covariance * J.transpose();
}

PoseNees poseNees(const SE3& truth, const StateEstimate& estimate) {
  const Vector6d xi = invariantError(truth, estimate.world_T_imu);
  const Matrix6d P = invariantCovariance(estimate);
  return {nees<6>(xi, P), nees<3>(xi.tail<3>(), P.bottomRightCorner<3, 3>()),
          nees<3>(xi.head<3>(), P.topLeftCorner<3, 3>())};
}

double tiltNees(const SE3& truth, const StateEstimate& estimate) {
  return nees<2>(invariantError(truth, estimate.world_T_imu).segment<2>(3),
                 estimate.pose_covariance.block<2, 2>(3, 3));
}

double velocityNees(const Eigen::Vector3d& truth, const StateEstimate& estimate) {
  return nees<3>(truth - estimate.twist.head<3>(), estimate.twist_covariance.topLeftCorner<3, 3>());
}

double absoluteTrajectoryError(const Eigen::Matrix3Xd& estimate, const Eigen::Matrix3Xd& truth,
                               bool is_level) {
  Eigen::Matrix4d truth_T_estimate = Eigen::Matrix4d::Identity();
  if (is_level) {
    const Eigen::Matrix3d plane = Eigen::umeyama(estimate.topRows<2>(), truth.topRows<2>(), false);
    truth_T_estimate.topLeftCorner<2, 2>() = plane.topLeftCorner<2, 2>();
    truth_T_estimate.topRightCorner<2, 1>() = plane.topRightCorner<2, 1>();
    truth_T_estimate(2, 3) = truth.row(2).mean() - estimate.row(2).mean();
  } else {
    truth_T_estimate = Eigen::umeyama(estimate, truth, false);
  }
  const Eigen::Matrix3Xd error = truth_T_estimate.topRows<3>() * estimate.colwise().homogeneous() - truth;
  return std::sqrt(error.colwise().squaredNorm().mean());
}

std::pair<double, double> chiSquareMeanBounds(double dof, double runs) {
  constexpr double kNormal975 = 1.959963984540054;
  const double variance = 2.0 / (9.0 * dof * runs);
  const auto quantile = [&](double z) { return dof * std::pow(1.0 - variance + z * std::sqrt(variance), 3); };
  return {quantile(-kNormal975), quantile(kNormal975)};
}

void ReturnWatch::add(const StereoFrame& frame) {
  for (const StereoFeatureObservation& feature : frame.features) {
    const auto [entry, is_new] = last_seen_.emplace(feature.id, frames_);
    if (!is_new && entry->second + 1 < frames_) returned_ = true;
    entry->second = frames_;
  }
  ++frames_;
}

void YawVarianceWatch::add(const Matrix6d& pose_covariance) {
  const double variance = pose_covariance(5, 5);
  if (last_ && *last_ > 0.0) largest_fall_ = std::max(largest_fall_, (*last_ - variance) / *last_);
  last_ = variance;
}

} // namespace vi_ekf_slam::simulation

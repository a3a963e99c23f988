#include "vi_ekf_slam/core/map/path_estimate.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

/// The symmetric X without what is negative of it, in units in which `scale` has ones on its diagonal.
Matrix6d positivePart(const Matrix6d& X, const Matrix6d& scale) {
  const Vector6d sigma = scale.diagonal().cwiseMax(0.0).cwiseSqrt();
  const Vector6d inverse = (sigma.array() > 0.0).select(sigma.cwiseInverse(), Vector6d::Zero());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(inverse.asDiagonal() * X * inverse.asDiagonal());
  const Matrix6d V = sigma.asDiagonal() * eigen.eigenvectors();
  return V * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * V.transpose();
}

} // namespace

PathEstimate::Pose PathEstimate::at(Stamp stamp, const SE3& then, const Matrix6d& covariance) const {
  const auto later = std::upper_bound(nodes.begin(), nodes.end(), stamp,
                                      [](Stamp s, const PathNode& node) { return s < node.stamp; });
  if (later == nodes.begin()) return {then, covariance};
  const PathNode& a = *std::prev(later);
  const SE3 from_a = a.now * (a.after.inverse() * then);
  if (stamp == a.stamp) return {from_a, a.covariance};
  if (later == nodes.end() || !later->follows)
    return {from_a, a.covariance + positivePart(covariance - a.covariance_soon, covariance)};
  const PathNode& b = *later;
  const SE3 from_b = b.now * (b.before.inverse() * then);
  const double share = secondsBetween(a.stamp, stamp) / secondsBetween(a.stamp, b.stamp);
  const auto between = [share](const Matrix6d& A, const Matrix6d& B) {
    return Matrix6d((1.0 - share) * A + share * B);
  };
  // Of the noise that this moment does not share with the nodes nothing has been learned.
  const Matrix6d own = covariance - between(a.covariance_soon, b.covariance_soon + b.learned);
  const Eigen::Vector3d turn = so3::Log(from_a.rotation().transpose() * from_b.rotation());
  return {SE3(from_a.rotation() * so3::Exp(share * turn),
              (1.0 - share) * from_a.translation() + share * from_b.translation()),
          between(a.covariance, b.covariance) + positivePart(own, covariance)};
}

} // namespace vi_ekf_slam

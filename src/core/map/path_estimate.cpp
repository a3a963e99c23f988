#include "vi_ekf_slam/core/map/path_estimate.hpp"

#include <algorithm>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

PathEstimate::Pose PathEstimate::at(Stamp stamp, const SE3& then, const Matrix6d& covariance) const {
  const auto later = std::upper_bound(nodes.begin(), nodes.end(), stamp,
                                      [](Stamp s, const PathNode& node) { return s < node.stamp; });
  if (later == nodes.begin()) return {then, covariance};
  const PathNode& a = *std::prev(later);
  const SE3 from_a = a.now * (a.after.inverse() * then);
  if (stamp == a.stamp || later == nodes.end() || !later->follows) return {from_a, a.covariance};
  const PathNode& b = *later;
  const SE3 from_b = b.now * (b.before.inverse() * then);
  const double share = secondsBetween(a.stamp, stamp) / secondsBetween(a.stamp, b.stamp);
  const Eigen::Vector3d turn = so3::Log(from_a.rotation().transpose() * from_b.rotation());
  return {SE3(from_a.rotation() * so3::Exp(share * turn),
              (1.0 - share) * from_a.translation() + share * from_b.translation()),
          (1.0 - share) * a.covariance + share * b.covariance};
}

} // namespace vi_ekf_slam

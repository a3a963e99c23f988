#include "vi_ekf_slam/core/filter/validity.hpp"

#include "vi_ekf_slam/core/geometry/gaussian.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kNegligible = 1e-9; // of a correlation matrix's eigenvalues

} // namespace

bool isValid(const Filter& filter, bool thoroughly) {
  const Eigen::Index c = filter.coreRows();
  const auto P = filter.covariance();
  const auto core = P.topLeftCorner(c, c);
  const SE3& pose = filter.pose();
  if (!pose.rotation().allFinite() || !pose.translation().allFinite() || !core.diagonal().allFinite() ||
      !(core.diagonal().array() >= 0.0).all())
    return false;
  for (const Handle handle : filter.variables().handles()) {
    if (filter.rowOf(handle) >= c) break;
    if (filter.variables().chartOf(handle) != Chart::kPose && !filter.variables().mean(handle).allFinite())
      return false;
  }
  if (!thoroughly) return true;
  if (!P.diagonal().allFinite() || !(P.diagonal().array() >= 0.0).all()) return false;
  return isPositiveSemidefinite(core, kNegligible);
}

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/observation/track_slip.hpp"

#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

Vector6d TrackSlip::variances() const {
  Vector6d sigma = Vector6d::Zero();
  sigma[0] = options_.sigma; // tracks lag along the way
  sigma.tail<3>().setConstant(options_.rotation_sigma);
  return sigma.cwiseAbs2();
}

void TrackSlip::addTo(Filter& filter) {
  variable_.reset();
  if (options_.sigma > 0.0 || options_.rotation_sigma > 0.0)
    variable_ =
        filter.augment(Chart::kVector, Vector6d::Zero(), Matrix6d(variances().asDiagonal()), {}, kName);
}

void TrackSlip::propagate(Filter& filter, double distance_m) const {
  if (!variable_ || !(distance_m > 0.0)) return;
  const double kept = std::exp(-distance_m / options_.length_m);
  const Eigen::Index c = filter.coreRows(), row = filter.rowOf(*variable_);
  CoreStep step;
  step.pose = filter.pose();
  step.row = row;
  step.F.setZero(6, c);
  step.F.middleCols<6>(row).diagonal().setConstant(kept);
  step.Q.setZero(c, c);
  step.Q.block<6, 6>(row, row) = ((1.0 - kept * kept) * variances()).asDiagonal();
  step.means.emplace_back(*variable_, kept * filter.variables().mean(*variable_));
  filter.propagate(step);
}

void TrackSlip::apply(Filter& filter, const LandmarkMap& map, double distance_m) const {
  if (!variable_ || !(distance_m > 0.0)) return;
  const Eigen::Matrix3d R = distance_m * filter.pose().rotation();
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(filter.rows() - filter.coreRows(), 6);
  for (const Landmark& landmark : map.active()) {
    if (landmark.reactivated) continue; // not in view
    const Eigen::Vector3d way = filter.variables().point(landmark.variable) - filter.pose().translation();
    G.middleRows<3>(filter.rowOf(landmark.variable) - filter.coreRows()) << R, -so3::hat(way) * R;
  }
  filter.moveRest(*variable_, G);
}

} // namespace vi_ekf_slam

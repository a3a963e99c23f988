#include "vi_ekf_slam/core/tracking/track_slip.hpp"

#include <algorithm>
#include <cmath>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {

Eigen::Vector4d TrackSlip::variances() const {
  Eigen::Vector4d sigma;
  sigma << options_.sigma, Eigen::Vector3d::Constant(options_.rotation_sigma);
  return sigma.cwiseAbs2();
}

void TrackSlip::addTo(Filter& filter) {
  variable_.reset();
  if (options_.sigma > 0.0)
    variable_ = filter.augment(Chart::kVector, Eigen::Vector4d::Zero(),
                               Eigen::Matrix4d(variances().asDiagonal()), {}, kName);
}

void TrackSlip::propagate(Filter& filter, double distance_m) const {
  if (!variable_ || !(distance_m > 0.0)) return;
  const double kept = std::exp(-distance_m / options_.length_m);
  CoreStep step;
  step.pose = filter.pose();
  step.row = filter.rowOf(*variable_);
  step.F = kept * Eigen::Matrix4d::Identity();
  step.Q = ((1.0 - kept * kept) * variances()).asDiagonal();
  step.means.emplace_back(*variable_, kept * filter.variables().mean(*variable_));
  filter.propagate(step);
}

bool TrackSlip::isPossible(const StereoFrame& frame) {
  return std::none_of(frame.features.begin(), frame.features.end(),
                      [](const StereoFeatureObservation& feature) { return feature.sigma > 0.0; });
}

void TrackSlip::apply(Filter& filter, const LandmarkMap& map, const Eigen::Vector3d& displacement) const {
  if (!variable_ || displacement.isZero()) return;
  const Eigen::Matrix3d R = displacement.norm() * filter.pose().rotation();
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(filter.rows() - filter.coreRows(), 4);
  for (const Landmark& landmark : map.active()) {
    if (landmark.reactivated) continue; // not in view
    const Eigen::Vector3d ray = filter.variables().point(landmark.variable) - filter.pose().translation();
    G.middleRows<3>(filter.rowOf(landmark.variable) - filter.coreRows()) << displacement, -so3::hat(ray) * R;
  }
  filter.moveRest(*variable_, G);
}

} // namespace vi_ekf_slam

// What State does with its inactive landmarks.

#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/invariant/columns3.hpp"
#include "vi_ekf_slam/core/invariant/state.hpp"

namespace vi_ekf_slam::invariant {

/// d = e - [m]x xi_R: the error along the world axes, which does not change while the vehicle moves.
void State::deactivateLandmark(std::size_t index, const Eigen::Matrix3d& slid) {
  const Landmark landmark = landmarks_[index];
  const Eigen::Index row = offsetOf(index), last = size() - 3;
  const Eigen::Matrix3d own = landmarkCovariance(index) + slid;
  const auto P = covariance();
  const Eigen::Matrix3d M = so3::hat(landmark.position); // -[m]x^T = [m]x
  InactiveMap::Columns3 cross = P.middleCols<3>(row).topRows(last);
  addTurned(P.middleCols<3>(kRotation).topRows(last), M, cross);
  if (row != last) cross.middleRows<3>(row) = P.block<3, 3>(last, row) + P.block<3, 3>(last, kRotation) * M;
  inactive_->add(landmark, own, std::move(cross), row, last);
  dropLandmark(index);
}

/// e = d + [m]x xi_R.
void State::activateLandmarks(const std::vector<FeatureId>& ids) {
  inactive_->settle(size(), ids.size());
  for (const FeatureId id : ids) {
    const InactiveMap::Taken taken = inactive_->take(id);
    const Eigen::Matrix3d M = so3::hat(taken.inactive.landmark.position);
    inactive_->appendActive(taken.others + M * inactive_->settledCross().middleRows<3>(kRotation));
    const Eigen::Index n = size();
    reserve(n + 3);
    const InactiveMap::Columns3 cross =
        taken.cross - covariance_.block(0, kRotation, n, 3) * M; // [m]x^T = -[m]x
    const Eigen::Matrix3d mixed = M * taken.cross.middleRows<3>(kRotation);
    covariance_.block(0, n, n, 3) = cross;
    covariance_.block(n, 0, 3, n) = cross.transpose();
    const Eigen::Matrix3d own = taken.inactive.covariance + mixed + mixed.transpose() +
                                M * covariance_.block<3, 3>(kRotation, kRotation) * M.transpose();
    covariance_.block<3, 3>(n, n) = 0.5 * (own + own.transpose());
    landmarks_.push_back(taken.inactive.landmark);
    landmarks_.back().anchored = true;
  }
}

std::vector<InactiveLandmark> State::marginaliseOldest(std::size_t count) {
  return inactive_->marginaliseOldest(count, size());
}

std::vector<InactiveLandmark> State::inactiveLandmarks(InactiveMap::Covariances covariances) const {
  if (!inactive_) return {};
  return inactive_->estimates(size(), covariances);
}

} // namespace vi_ekf_slam::invariant

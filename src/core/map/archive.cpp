#include "vi_ekf_slam/core/map/archive.hpp"

namespace vi_ekf_slam {

void Archive::put(const LandmarkEstimate& landmark) {
  if (landmarks_.insert_or_assign(landmark.id, landmark).second) order_.push_back(landmark.id);
  while (landmarks_.size() > capacity_) {
    landmarks_.erase(order_.front());
    order_.pop_front();
  }
}

/// cov(a + b) <= 2 cov(a) + 2 cov(b).
void Archive::move(const SE3& to_T_frame, const Eigen::Vector3d& about, const Matrix6d& alignment) {
  const Eigen::Matrix3d& R = to_T_frame.rotation();
  for (auto& [id, landmark] : landmarks_) {
    landmark.position = to_T_frame * landmark.position;
    const Eigen::Matrix<double, 3, 6> J = se3::pointJacobian(landmark.position - about);
    const Eigen::Matrix3d covariance =
        2.0 * (R * landmark.covariance * R.transpose() + J * alignment * J.transpose());
    landmark.covariance = 0.5 * (covariance + covariance.transpose());
  }
}

} // namespace vi_ekf_slam

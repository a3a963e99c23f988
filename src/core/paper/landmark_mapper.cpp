#include "vi_ekf_slam/core/paper/landmark_mapper.hpp"

#include <Eigen/Cholesky>

#include "vi_ekf_slam/core/paper/observation.hpp"

namespace vi_ekf_slam::paper {
namespace {

/// Eq. 17 for one landmark; returns the normalised innovation squared (4 degrees of freedom).
double updateLandmark(const PredictedObservation& prediction, const StereoPixels& z, double V,
                      LandmarkEstimate& landmark) {
  const Eigen::Matrix<double, 4, 3>& H = prediction.by_landmark;
  const Eigen::Matrix<double, 4, 3> HP = H * landmark.covariance;
  const Eigen::LLT<Eigen::Matrix4d> S(HP * H.transpose() + V * Eigen::Matrix4d::Identity());
  const Eigen::Vector4d innovation = z - prediction.pixels;
  landmark.position += HP.transpose() * S.solve(innovation);
  const Eigen::Matrix<double, 4, 3> A = S.matrixL().solve(HP);
  landmark.covariance -= A.transpose() * A;
  return innovation.dot(S.solve(innovation));
}

} // namespace

FrameReport LandmarkMapper::update(const StereoRig& rig, const SE3& imu_T_world, const StereoFrame& frame) {
  FrameReport report;
  report.stamp = frame.stamp;
  report.features = frame.features.size();
  for (const auto& feature : frame.features) {
    if (!isSelected(feature.id, config_.landmark_fraction)) continue;
    if (!isPlausible(feature.pixels)) {
      ++report.invalid;
      continue;
    }
    const auto known = landmarks_.find(feature.id);
    if (known == landmarks_.end()) {
      const auto position = initialLandmark(rig, imu_T_world, feature.pixels, config_);
      if (!position) {
        ++report.invalid;
        continue;
      }
      landmarks_[feature.id] = {feature.id, *position,
                                config_.prior_landmark_variance * Eigen::Matrix3d::Identity()};
      ++report.initialised;
      continue;
    }
    const auto prediction = predictObservation(rig, imu_T_world, known->second.position, config_.min_depth_m);
    if (!prediction) {
      ++report.rejected;
      continue;
    }
    report.nis += updateLandmark(*prediction, feature.pixels, config_.pixel_noise, known->second);
    report.nis_dof += 4;
    ++report.used;
  }
  report.landmarks = landmarks_.size();
  return report;
}

std::vector<LandmarkEstimate> LandmarkMapper::landmarks() const {
  std::vector<LandmarkEstimate> all;
  all.reserve(landmarks_.size());
  for (const auto& [id, landmark] : landmarks_) all.push_back(landmark);
  return all;
}

} // namespace vi_ekf_slam::paper

#pragma once

#include <map>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/run/config.hpp"
#include "vi_ekf_slam/core/slam/estimator.hpp"

namespace vi_ekf_slam::paper {

/// Landmark EKF along a given trajectory (eq. 13 to 17).
///
/// The joint covariance is 3M x 3M. With the pose given and V the same for every pixel no update ever couples
/// two landmarks, so all its off-diagonal blocks stay exactly zero and only the diagonal ones are stored.
/// Landmarks out of view keep theirs.
class LandmarkMapper {
 public:
  explicit LandmarkMapper(const PaperConfig& config) : config_(config) {}

  /// Updates and initialises the landmarks of a frame seen from the given inverse pose.
  FrameReport update(const StereoRig& rig, const SE3& imu_T_world, const StereoFrame& frame);

  std::vector<LandmarkEstimate> landmarks() const;

 private:
  PaperConfig config_;
  std::map<FeatureId, LandmarkEstimate> landmarks_;
};

} // namespace vi_ekf_slam::paper

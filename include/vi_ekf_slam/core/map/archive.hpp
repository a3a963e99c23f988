#pragma once

#include <deque>
#include <map>

#include "vi_ekf_slam/core/map/map_estimate.hpp"

namespace vi_ekf_slam {

/// The last estimates of landmarks that have left the filter, by id: the last `capacity` of them.
class Archive {
 public:
  explicit Archive(std::size_t capacity) : capacity_(capacity) {}

  /// An estimate of the same id is replaced.
  void put(const LandmarkEstimate& landmark);
  /// All are in another frame, at to_T_frame of where they were. The transform's error along the new axes, of
  /// covariance `alignment` (6x6 of position and rotation about `about`), may be correlated with theirs.
  void move(const SE3& to_T_frame, const Eigen::Vector3d& about, const Matrix6d& alignment);
  const std::map<FeatureId, LandmarkEstimate>& landmarks() const { return landmarks_; }

 private:
  std::size_t capacity_;
  std::map<FeatureId, LandmarkEstimate> landmarks_;
  std::deque<FeatureId> order_;
};

} // namespace vi_ekf_slam

#pragma once

#include <deque>
#include <map>

#include "vi_ekf_slam/core/estimator.hpp"

namespace vi_ekf_slam::invariant {

/// The last estimates of landmarks that have left the filter, by id. Bounded: beyond `capacity` those that came first
/// are forgotten.
class Archive {
 public:
  explicit Archive(std::size_t capacity) : capacity_(capacity) {}

  /// An estimate of the same id is replaced.
  void put(const LandmarkEstimate& landmark);
  const std::map<FeatureId, LandmarkEstimate>& landmarks() const { return landmarks_; }

 private:
  std::size_t capacity_;
  std::map<FeatureId, LandmarkEstimate> landmarks_;
  std::deque<FeatureId> order_;
};

} // namespace vi_ekf_slam::invariant

#include "vi_ekf_slam/core/invariant/archive.hpp"

namespace vi_ekf_slam::invariant {

void Archive::put(const LandmarkEstimate& landmark) {
  if (landmarks_.insert_or_assign(landmark.id, landmark).second) order_.push_back(landmark.id);
  while (landmarks_.size() > capacity_) {
    landmarks_.erase(order_.front());
    order_.pop_front();
  }
}

} // namespace vi_ekf_slam::invariant

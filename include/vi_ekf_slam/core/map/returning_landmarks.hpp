#pragma once

#include <unordered_set>
#include <vector>

#include "vi_ekf_slam/core/map/fuse_matches.hpp"
#include "vi_ekf_slam/core/map/settling_allowance.hpp"
#include "vi_ekf_slam/core/observation/stereo_model.hpp"

namespace vi_ekf_slam {

/// Inactive landmarks before the camera, the nearest first, that have been out of view for some time: those
/// that should come into view next.
std::vector<FeatureId> soonInView(const Filter& filter, const LandmarkMap& map, const StereoModel& model);

/// Closes loops where ids return. Such a landmark begins as a new one. When some have been seen often enough,
/// and settling the inactive ones has been saved up for, they are fused with what was seen of them before;
/// and what should come into view next is made active, to be recognised at once.
class ReturningLandmarks {
 public:
  /// After a frame. Those that were fused.
  Revisit update(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now,
                 SettlingAllowance& allowance);

  /// Fuses the active landmarks of these ids with the inactive ones, where `least` of them agree.
  Revisit fuse(Filter& filter, LandmarkMap& map, const StereoModel& model, Stamp now,
               const std::vector<FeatureId>& ids, std::size_t least);

  /// Whether a reactivated landmark that is not in view is still expected there.
  static bool isExpected(const Landmark& landmark, const Filter& filter, const StereoModel& model, Stamp now);

  void restart() { elsewhere_.clear(); }

 private:
  std::unordered_set<FeatureId> elsewhere_; ///< in view, and not where they were seen before
};

} // namespace vi_ekf_slam

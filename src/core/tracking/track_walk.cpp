#include "vi_ekf_slam/core/tracking/track_walk.hpp"

#include <cmath>

namespace vi_ekf_slam {

void letTracksWalk(Filter& filter, const LandmarkMap& map, const StereoModel& model, const StereoFrame& frame,
                   const std::vector<Association>& seen, double seconds) {
  for (const auto& [landmark, feature] : seen) {
    const double walk = frame.features[feature].walk;
    if (!(walk > 0.0)) continue;
    const Landmark& known = map.active()[landmark];
    if (known.reactivated) continue; // found again, not followed
    filter.addNoise(filter.rowOf(known.variable),
                    model.slideNoise(filter, known.variable, walk * std::sqrt(seconds)));
  }
}

} // namespace vi_ekf_slam

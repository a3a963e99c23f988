#include "vi_ekf_slam/core/loops/fuse_matches.hpp"

#include <algorithm>
#include <utility>

namespace vi_ekf_slam {
namespace {

/// Of those that were fused.
Stamp medianOf(const std::vector<Stamp>& stamps, const Fusion& fusion) {
  std::vector<Stamp> of_fused;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    if (fusion.fused[i]) of_fused.push_back(stamps[i]);
  }
  const auto middle = of_fused.begin() + static_cast<std::ptrdiff_t>(of_fused.size() / 2);
  std::nth_element(of_fused.begin(), middle, of_fused.end());
  return *middle;
}

} // namespace

FusedMatches fuseMatches(Filter& filter, LandmarkMap& map, const Matches& matches, std::size_t least,
                         double sigma) {
  const auto index = map.indexById();
  const std::size_t first = map.active().size(), pairs = matches.size();
  std::vector<FeatureId> ids;
  std::vector<Stamp> last_seen; // pair by pair
  for (const auto& [is_now, was] : matches) {
    ids.push_back(was);
    last_seen.push_back(map.inactive(map.inactiveVariable(was)).last_seen);
  }
  map.reactivate(filter, ids);
  std::vector<Duplicate> duplicates;
  for (std::size_t i = 0; i < pairs; ++i) {
    duplicates.push_back(
        {map.active()[index.at(matches[i].first)].variable, map.active()[first + i].variable});
  }
  Fusion fusion = fuseDuplicates(filter, duplicates, least, sigma);
  // From behind: whoever takes a place comes from behind it.
  for (std::size_t i = pairs; i-- > 0;) {
    if (!fusion.fused[i]) {
      map.deactivate(filter, first + i);
      continue;
    }
    const Landmark& before = map.active()[first + i];
    Landmark& landmark = map.active(index.at(matches[i].first));
    landmark.observations += before.observations;
    landmark.descriptors.add(before.descriptors);
    landmark.in_map = true;
    map.discard(filter, first + i);
  }
  Revisit revisit{fusion.count(), 0};
  if (revisit.landmarks > 0) revisit.last_seen = medianOf(last_seen, fusion);
  return {std::move(fusion), revisit};
}

} // namespace vi_ekf_slam

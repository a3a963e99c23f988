#include "vi_ekf_slam/core/loops/look_ups.hpp"

#include <algorithm>

namespace vi_ekf_slam {

LookUps::Candidates LookUps::candidates(const LandmarkMap& map) const {
  Candidates candidates;
  std::unordered_map<FeatureId, int> claims;
  for (std::size_t i = 0; i < map.active().size(); ++i) {
    const auto look_up = last_.find(map.active()[i].id);
    if (look_up == last_.end() || !look_up->second.known) continue;
    candidates.emplace_back(i, *look_up->second.known);
    ++claims[*look_up->second.known];
  }
  candidates.erase(std::remove_if(candidates.begin(), candidates.end(),
                                  [&claims](const auto& c) { return claims[c.second] > 1; }),
                   candidates.end());
  return candidates;
}

} // namespace vi_ekf_slam

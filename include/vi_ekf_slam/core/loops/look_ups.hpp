#pragma once

#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/loops/appearance_index.hpp"
#include "vi_ekf_slam/core/map/landmark_map.hpp"

namespace vi_ekf_slam {

/// Which of the known landmarks those in view look like: each is looked up when it comes into view, and again
/// when twice as much of it has been seen, a bounded number in a frame.
class LookUps {
 public:
  /// Landmarks in view (index of the active ones) and the known ones (id) that they look like.
  using Candidates = std::vector<std::pair<std::size_t, FeatureId>>;

  /// `most`: look-ups in a frame.
  explicit LookUps(std::size_t most) : most_(most) {}

  /// Of the active landmarks for which `mayReturn(const Landmark&)` those that are due; `reachOf(const
  /// Landmark&)` gives what AppearanceIndex::find allows.
  template <class MayReturn, class ReachOf>
  void update(const LandmarkMap& map, const AppearanceIndex& known, const MayReturn& mayReturn,
              const ReachOf& reachOf) {
    std::unordered_map<FeatureId, LookUp> in_view;
    std::size_t done = 0;
    for (const Landmark& landmark : map.active()) {
      if (!mayReturn(landmark)) continue;
      const auto last = last_.find(landmark.id);
      LookUp& look_up = in_view[landmark.id];
      if (last != last_.end()) look_up = last->second;
      if (look_up.observations * 2 > landmark.observations || done == most_) continue;
      ++done;
      look_up = {landmark.observations, std::nullopt};
      if (const auto found = known.find(landmark.descriptors, reachOf(landmark)))
        look_up.known = known[*found].id;
    }
    last_.swap(in_view);
  }

  /// Without those that two landmarks in view claim: two cannot be one.
  Candidates candidates(const LandmarkMap& map) const;
  /// As if the landmark in view had not been looked up yet.
  void forget(FeatureId id) { last_.erase(id); }
  void restart() { last_.clear(); }

 private:
  struct LookUp {
    std::size_t observations = 0; ///< of the landmark by then
    std::optional<FeatureId> known;
  };

  std::size_t most_;
  std::unordered_map<FeatureId, LookUp> last_; ///< of landmarks in view
};

} // namespace vi_ekf_slam

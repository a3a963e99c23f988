#pragma once

#include <cstdint>
#include <map>
#include <utility>

#include "vi_ekf_slam/simulation/drive_simulator.hpp"

namespace vi_ekf_slam::simulation {

/// Gives a new id to what an id goes astray to at a stale frame, as dataset_to_bag.py does.
class StaleRepair {
 public:
  void repair(DriveStep& step) {
    for (std::size_t i = 0; i < step.frame.features.size(); ++i) {
      FeatureId& id = step.frame.features[i].id;
      const std::pair<FeatureId, std::uint64_t> track(id, step.truth[i].point);
      if (step.truth[i].kind == ObservationKind::kStale) renewed_.emplace(track, next_++);
      const auto renewed = renewed_.find(track);
      if (renewed != renewed_.end()) id = renewed->second;
    }
  }

 private:
  std::map<std::pair<FeatureId, std::uint64_t>, FeatureId>
      renewed_;                         ///< by id and the point that it strayed to
  FeatureId next_ = FeatureId{1} << 40; ///< above any id of a drive
};

} // namespace vi_ekf_slam::simulation

#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "vi_ekf_slam/core/filter/filter.hpp"
#include "vi_ekf_slam/core/map/path_estimate.hpp"

namespace vi_ekf_slam {

/// The path as clones of the pose every few metres: inactive variables of the filter, which cost a frame
/// nothing, and which a loop that closes moves through their correlations. Clones that are marginalised stay
/// where they are then.
class PoseClones {
 public:
  /// After a frame, whose loop closures found the pose at `before`; `closed`: there was one.
  void add(Filter& filter, Stamp now, const SE3& before, bool closed);
  /// The pose of now is not where motion alone has led from the last clone.
  void breakOff() { follows_ = false; }
  /// Of these variables, which are gone from the filter, clones keep their last estimates.
  void archive(const std::vector<InactiveStore::Estimate>& gone);
  /// Earlier poses are in another world.
  void clear() { *this = PoseClones(); }

  /// The loop that the frame of the last clone has closed with `landmarks` that were seen at `before`.
  /// Nothing where no clone of then is left in the filter.
  std::optional<ClosedLoop> close(Filter& filter, Stamp before, std::size_t landmarks);

  /// With the pose of `now`; `inactive` are the filter's estimates.
  PathEstimate estimate(const Filter& filter, const std::vector<InactiveStore::Estimate>& inactive,
                        Stamp now) const;

 private:
  struct Clone {
    Handle variable;
    PathNode node; ///< as of then
  };

  static PathNode moved(const PathNode& node, const InactiveStore::Estimate& estimate);

  std::deque<Clone> clones_;
  std::vector<PathNode> archive_;
  std::vector<LoopEnds> loops_;
  bool follows_ = true;
};

} // namespace vi_ekf_slam

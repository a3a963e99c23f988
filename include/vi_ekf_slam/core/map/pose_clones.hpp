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
  /// In a frame that has corrected the pose. Before there are new landmarks: a block of the filter's inactive
  /// variables that begins here then is the smaller.
  void add(Filter& filter, Stamp now);
  /// The pose of now is not where motion alone has led from the last clone.
  void breakOff() { follows_ = false; }
  /// Of these variables, which are gone from the filter, clones keep their last estimates.
  void archive(const std::vector<InactiveStore::Estimate>& gone);
  /// Earlier poses are in another world.
  void clear() { *this = PoseClones(); }

  /// The frame of `now` has found `landmarks` again that were seen `last` then, and the pose, which was
  /// `before` with `covariance`, where it is. The loop; nothing where no clone of then is left in the filter.
  std::optional<ClosedLoop> close(Filter& filter, Stamp now, const SE3& before, const Matrix6d& covariance,
                                  Stamp last, std::size_t landmarks);

  /// With the pose of `now`; `inactive` are the filter's estimates.
  PathEstimate estimate(const Filter& filter, const std::vector<InactiveStore::Estimate>& inactive,
                        Stamp now) const;

 private:
  struct Clone {
    Handle variable;
    PathNode node;            ///< as of then
    Eigen::Matrix3d rotation; ///< from which the variable's mean turns
  };

  PathNode nodeOf(const Filter& filter, Stamp now) const;
  void append(Filter& filter, Stamp now);
  PathNode moved(const Clone& clone, const InactiveStore::Estimate& estimate) const;

  std::deque<Clone> clones_;
  std::vector<PathNode> archive_;
  std::vector<LoopEnds> loops_;
  bool follows_ = true;
};

} // namespace vi_ekf_slam

#pragma once

#include <cstddef>
#include <vector>

#include "vi_ekf_slam/core/geometry/se3.hpp"
#include "vi_ekf_slam/core/sensors/measurement.hpp"
#include "vi_ekf_slam/core/types.hpp"

namespace vi_ekf_slam {

/// The pose at one moment of the drive: as it was estimated then, and as it is known now. Poses are
/// world_T_imu.
struct PathNode {
  Stamp stamp = 0;
  SE3 before, after; ///< the estimate of then, without and with the loop that the moment's frame has closed
  SE3 now;
  Matrix6d covariance = Matrix6d::Zero(); ///< of `now`, (position, rotation) along the world's axes
  /// What it was when the next node came, before a loop that was closed there: without what the frames after
  /// this one told of it alone.
  Matrix6d covariance_soon = Matrix6d::Zero();
  Matrix6d learned = Matrix6d::Zero(); ///< by how much that loop made the covariance of the pose smaller
  /// Whether motion alone leads here from the node before; else somebody has said where the body is, or the
  /// estimate began anew.
  bool follows = true;
};

/// Two moments between which a loop was closed.
struct LoopEnds {
  Stamp before = 0, now = 0;
};

/// The path of a drive after all that has been learned since, at moments some way apart.
struct PathEstimate {
  struct Pose {
    SE3 world_T_imu;
    Matrix6d covariance;
  };

  /// What is known now of a moment whose pose was estimated as `then` with `covariance`. Between two nodes it
  /// keeps its motion from the one and to the other, weighted by time, and of its covariance what it does not
  /// share with them; before the first node nothing changes.
  Pose at(Stamp stamp, const SE3& then, const Matrix6d& covariance) const;

  std::vector<PathNode> nodes; ///< by stamp
  std::vector<LoopEnds> loops;
};

/// A loop that a frame has closed.
struct ClosedLoop {
  LoopEnds ends;
  SE3 before_T_now; ///< of the IMU, after the closure
  /// 6x6 of (position, rotation) along the axes of the IMU before.
  Matrix6d covariance = Matrix6d::Zero();
  std::size_t landmarks = 0; ///< that were found again
};

} // namespace vi_ekf_slam

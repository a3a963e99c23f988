#pragma once

#include <Eigen/Core>
#include <vector>

namespace vi_ekf_slam {

/// Points of a map after corrections d that are known to first order: x + d would stretch what a large angle
/// turns, by half of its square (1.5 % at 10 deg). `points` are in the order in which the body passed them,
/// so that those that follow each other are a piece of the map; each piece is turned as its corrections say,
/// and the pieces are put end to end from the first one on, each way between two of them turned likewise. The
/// first one moves along the screw of its turn and shift: what it turns about stays where it is. To first
/// order the same.
std::vector<Eigen::Vector3d> moveAsChain(const std::vector<Eigen::Vector3d>& points,
                                         const std::vector<Eigen::Vector3d>& corrections);

} // namespace vi_ekf_slam

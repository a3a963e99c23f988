#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

namespace vi_ekf_slam {

Eigen::Vector3d centreOf(const std::vector<Eigen::Vector3d>& points);
/// Standard deviation (m) along the second longest principal axis: 0 where the points are in a line.
double widthOf(const std::vector<Eigen::Vector3d>& points);

/// Points in cubes, to find the nearest one.
class PointGrid {
 public:
  /// `cell` m, at least the largest distance asked for.
  PointGrid(const std::vector<Eigen::Vector3d>& points, double cell);

  std::size_t size() const { return points_.size(); }

  /// Index and distance (m) of the nearest point nearer than `tolerance`.
  std::optional<std::pair<std::size_t, double>> nearest(const Eigen::Vector3d& where, double tolerance) const;

 private:
  std::uint64_t keyOf(const Eigen::Vector3d& where, int dx, int dy, int dz) const;

  std::vector<Eigen::Vector3d> points_;
  double cell_;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

} // namespace vi_ekf_slam

#include "vi_ekf_slam/core/map/points.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace vi_ekf_slam {

Eigen::Vector3d centreOf(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) centre += p / static_cast<double>(points.size());
  return centre;
}

double widthOf(const std::vector<Eigen::Vector3d>& points) {
  const Eigen::Vector3d centre = centreOf(points);
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points)
    scatter += (p - centre) * (p - centre).transpose() / static_cast<double>(points.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(scatter, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, axes.eigenvalues()[1]));
}

PointGrid::PointGrid(const std::vector<Eigen::Vector3d>& points, double cell) : points_(points), cell_(cell) {
  for (std::size_t i = 0; i < points_.size(); ++i) cells_[keyOf(points_[i], 0, 0, 0)].push_back(i);
}

std::uint64_t PointGrid::keyOf(const Eigen::Vector3d& where, int dx, int dy, int dz) const {
  const auto part = [this](double x, int d) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(x / cell_)) + d) & 0x1fffff;
  };
  return part(where.x(), dx) << 42 | part(where.y(), dy) << 21 | part(where.z(), dz);
}

std::optional<std::pair<std::size_t, double>> PointGrid::nearest(const Eigen::Vector3d& where,
                                                                 double tolerance) const {
  std::optional<std::pair<std::size_t, double>> best;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const auto cell = cells_.find(keyOf(where, dx, dy, dz));
        if (cell == cells_.end()) continue;
        for (const std::size_t i : cell->second) {
          const double distance = (points_[i] - where).norm();
          if (distance < tolerance && (!best || distance < best->second)) best.emplace(i, distance);
        }
      }
    }
  }
  return best;
}

} // namespace vi_ekf_slam

#include <algorithm>

#include "vi_ekf_slam/simulation/scene.hpp"

namespace vi_ekf_slam::simulation {
namespace {

constexpr int kPoints = 9000;                       // more than 250 of them in a view
constexpr double kFurniture = 0.3;                  // share of the points that stand off the walls
constexpr double kNearest = 0.7;                    // m, from where the body may be
constexpr double kWallLeast = 2.5, kWallMost = 4.0; // m, the same of the walls
constexpr double kFloor = 1.5;                      // m, of floor and ceiling

/// m from `p`, inside `box`, to its surface along `direction`.
double distanceToSurface(const Eigen::AlignedBox3d& box, const Eigen::Vector3d& p,
                         const Eigen::Vector3d& direction) {
  double distance = 1e9;
  for (int i = 0; i < 3; ++i) {
    const double end = direction[i] > 0.0 ? box.max()[i] : box.min()[i];
    if (direction[i] != 0.0) distance = std::min(distance, (end - p[i]) / direction[i]);
  }
  return distance;
}

} // namespace

RoomScene::RoomScene(const DriveOptions& options, const View& view, const Eigen::AlignedBox3d& around)
    : PointScene(options, view) {
  const auto wall = [this] { return random_.uniform(kWallLeast, kWallMost); };
  const Eigen::Vector3d low(wall(), wall(), kFloor), high(wall(), wall(), kFloor);
  const Eigen::AlignedBox3d room(around.min() - low, around.max() + high);
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(kNearest);
  const Eigen::AlignedBox3d near(around.min() - margin, around.max() + margin);
  while (points_.size() < kPoints) {
    Eigen::Vector3d from;
    for (int i = 0; i < 3; ++i) from[i] = random_.uniform(around.min()[i], around.max()[i]);
    const Eigen::Vector3d direction = random_.normal3().normalized();
    const double share = random_.uniform() < kFurniture ? random_.uniform(0.5, 1.0) : 1.0;
    const Eigen::Vector3d point = from + share * distanceToSurface(room, from, direction) * direction;
    if (!near.contains(point)) points_.push_back(point);
  }
  drawStrengths(options);
}

} // namespace vi_ekf_slam::simulation

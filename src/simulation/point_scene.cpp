#include <algorithm>
#include <cmath>
#include <utility>

#include "vi_ekf_slam/simulation/scene.hpp"

namespace vi_ekf_slam::simulation {

PointScene::PointScene(const DriveOptions& options, const View& view)
    : view_(view), random_(options.seed, RandomStream::kScene) {}

void PointScene::drawStrengths(const DriveOptions& options) {
  Random random(options.seed, RandomStream::kStrengths);
  for (std::size_t i = 0; i < points_.size(); ++i)
    strengths_.push_back(std::exp(options.strength_spread * random.normal()));
}

std::vector<ScenePoint> PointScene::detect(const SE3& world_T_cam, std::size_t count,
                                           const std::vector<std::uint64_t>& taken) {
  const SE3 cam_T_world = world_T_cam.inverse();
  // Weighted draw without replacement (Efraimidis and Spirakis 2006): the smallest Exp(weight) win.
  std::vector<std::pair<double, std::uint64_t>> candidates;
  for (std::uint64_t i = 0; i < points_.size(); ++i) {
    const Eigen::Vector3d p = cam_T_world * points_[i];
    if (!view_.sees(p) || std::binary_search(taken.begin(), taken.end(), i)) continue;
    if (occluded(world_T_cam.translation(), points_[i])) continue;
    candidates.emplace_back(random_.exponential() * p.z() / strengths_[i], i);
  }
  count = std::min(count, candidates.size());
  std::partial_sort(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count),
                    candidates.end());
  std::vector<ScenePoint> found;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t index = candidates[i].second;
    found.push_back({index, points_[index], looks_.empty() ? index : looks_[index]});
  }
  return found;
}

} // namespace vi_ekf_slam::simulation
